import json
import math
import re
from dataclasses import asdict, replace

import numpy as np
import pytest

import app.bench as bench
from app.bench import driving, planning, sensing, serving
from app.bench.measure import faster, interleaved, percentile
from app.bench.peers import ReferenceDwa, numpy_patch
from app.bench.planning import _choose, _situation
from planner.elevation_map import MapConfig
from scenes.pose import Pose

FIELDS = ["name", "ours", "peer", "peer_name", "ratio", "unit", "identical"]


def test_the_cases_are_those_that_were_promised():
    assert list(bench.CASES) == [
        "dwa_cycle",
        "lidar_turn",
        "scan_to_patch",
        "semantic_image",
        "tick",
        "mission_speed",
        "covert_tick",
        "covert_mission_speed",
        "click_to_goal",
        "drag_to_overlay",
        "viewshed",
        "united_exposure",
        "covert_route",
        "space_time",
        "training",
        "policy_decision",
    ]


def test_a_result_has_the_fields_of_the_interface_and_fits_json():
    result = asdict(faster("a", 2.0, 10.0, "b", "same"))
    assert list(result) == FIELDS and result["ratio"] == 5.0
    json.dumps(result, allow_nan=False)


def test_only_runs_one_case_and_the_table_shows_peer_and_comparison(monkeypatch):
    monkeypatch.setitem(bench.CASES, "tick", lambda: faster("tick", 2.0, 10.0, "the period", "all the same"))
    results = bench.run("tick")
    assert [r["name"] for r in results] == ["tick"]
    text = bench.table(results)
    assert "5×" in text and "peer: the period" in text and "same: all the same" in text


def test_an_unknown_case_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="no bench 'x'; choose one of dwa_cycle"):
        bench.run("x")


def test_a_case_whose_peer_is_not_installed_is_left_out_and_said_so(monkeypatch, capsys):
    monkeypatch.setattr(bench, "PEERS_TO_INSTALL", {"tick": "no_such_library"})
    monkeypatch.setattr(bench, "CASES", {"tick": bench.CASES["tick"]})
    assert bench.run() == []
    assert "tick is left out: needs no_such_library" in capsys.readouterr().err
    with pytest.raises(ValueError, match="needs no_such_library"):
        bench.run("tick")


def test_both_sides_are_called_in_turns_after_a_call_that_does_not_count():
    calls = []
    interleaved(lambda: calls.append("o"), lambda: calls.append("p"), 2, ours_per_turn=2)
    assert "".join(calls) == "op" + "oop" * 2
    assert percentile([1.0, 2.0, 3.0], 50.0) == 2.0


def test_the_reference_drives_straight_to_an_open_goal():
    v, w, cost = ReferenceDwa().choose(
        np.array([0.0, 0.0, 0.0, 0.5, 0.0]), np.array([10.0, 0.0]), np.array([[0.0, 50.0]])
    )
    assert v == pytest.approx(0.51, abs=0.011) and abs(w) < math.radians(0.2)
    assert cost == pytest.approx(1.0 - v + 1.0 / 50.0, abs=1e-3)


def test_the_reference_finds_no_arc_inside_an_obstacle():
    choice = ReferenceDwa().choose(
        np.array([0.0, 0.0, 0.0, 0.5, 0.0]), np.array([10.0, 0.0]), np.array([[0.5, 0.0]])
    )
    assert choice == (0.0, 0.0, math.inf)


@pytest.mark.parametrize("seed", range(3))
def test_our_window_chooses_as_the_reference_does(seed):
    peer, situation = ReferenceDwa(), _situation(np.random.default_rng(seed))
    assert _choose(peer, *situation) == pytest.approx(peer.choose(*situation), abs=1e-9)


def test_the_gridding_reference_knows_a_plane_where_points_lie():
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-9.5, 9.5, 0.1), np.arange(-3.0, 3.0, 0.1)))
    points = np.column_stack([x, y, 0.1 * x])
    heights, unknown = numpy_patch(points, Pose(0.0, 0.0, 0.2), MapConfig())
    forward = np.arange(-9.75, 10.0, 0.5)
    middle = slice(16, 24)
    assert not unknown[middle, 1:-1].any() and unknown[0].all()
    np.testing.assert_allclose(heights[20, 1:-1], 0.1 * forward[1:-1] - 0.2, atol=0.02)


@pytest.mark.parametrize("name", ["dwa_cycle", "lidar_turn", "semantic_image", "scan_to_patch"])
def test_a_case_measures_and_compares(monkeypatch, name):
    for module in (planning, sensing):
        monkeypatch.setattr(module, "REPEATS", 1)
    monkeypatch.setattr(planning, "SITUATIONS", 2)
    (result,) = bench.run(name)
    assert list(result) == FIELDS
    assert all(math.isfinite(result[key]) and result[key] > 0.0 for key in ("ours", "peer", "ratio"))
    shares = [float(share) for share in re.findall(r"([\d.]+) %", result["identical"])]
    assert all(share > 90.0 for share in shares)


def test_a_drive_comes_out_the_same_again_and_the_result_says_so(monkeypatch):
    monkeypatch.setattr(driving, "REPEATED_TICKS", 8)
    drive = driving._drive("least_cost", driving.SEEDS[0], 8)
    assert len(drive.motion) == len(drive.planner_ms) == 8 and drive.wall_s > 0.0
    assert driving._repeatability(drive) == (
        "the first 8 ticks driven again gave the same poses to the last bit"
    )
    assert "OTHER poses" in driving._repeatability(replace(drive, motion=drive.motion[::-1]))


def test_goals_are_clicked_on_a_real_server(monkeypatch):
    monkeypatch.setattr(serving, "CLICK_OFFSETS", serving.CLICK_OFFSETS[:2])
    result = serving.click_to_goal()
    assert result.identical.startswith("2 goals set")
