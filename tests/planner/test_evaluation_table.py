"""Tables: rows say how many, why drives failed, what the paper reports and what the best routes are seen."""

import math

import pytest
from drives import mission

from planner.evaluation_table import ALL_TERRAINS, bounds, reasons, tabulate, totals
from planner.methods import COMPARED


def test_a_row_counts_the_reasons_of_failure_and_means_successes_alone():
    missions = [mission(0), mission(1, "collided", trajectory_length_m=99.0), mission(2, "timeout")]
    (row,) = tabulate(missions)
    assert row["missions"] == 3 and row["successes"] == 1
    assert row["success_rate"] == pytest.approx(1 / 3)
    assert row["failures"] == {"collided": 1, "timeout": 1}
    assert row["collision_rate"] == row["timeout_rate"] == pytest.approx(1 / 3)
    assert row["trajectory_length_m"] == 12.0 and row["length_ratio"] == pytest.approx(1.2)


def test_every_mean_says_over_how_many_and_how_sure():
    seen = [mission(seed, exposed_s=float(seed)) for seed in range(4)] + [mission(4), mission(5, "stuck")]
    (row,) = tabulate(seen)
    assert row["n"]["exposed_s"] == 4 and row["n"]["execution_time_s"] == 5
    low, high = row["ci95"]["exposed_s"]
    assert low < row["exposed_s"] == 1.5 < high
    assert row["ci95"]["execution_time_s"] == [20.0, 20.0]
    (alone,) = tabulate([mission(0)])
    assert alone["ci95"]["execution_time_s"] is None


def test_means_over_no_success_are_left_out():
    (row,) = tabulate([mission(0, "stuck")])
    assert row["trajectory_length_m"] is None and not math.isnan(row["success_rate"])
    assert row["n"]["trajectory_length_m"] == 0


def test_tilt_is_the_larger_of_roll_and_pitch():
    (row,) = tabulate([mission(0, max_roll_deg=3.0, max_pitch_deg=5.0)])
    assert row["max_tilt_deg"] == 5.0


def test_a_row_has_the_keys_that_others_rely_on():
    (row,) = tabulate([mission(0)])
    assert set(row) >= {
        *("terrain", "method", "suite", "observers", "perception", "missions", "successes", "success_rate"),
        *("success_ci95", "trajectory_length_m", "length_ratio", "execution_time_s", "exposure_fraction"),
        *("exposed_s", "longest_exposure_s", "detection_probability", "avoidable_removed"),
        *("cover_fraction", "concealed_fraction", "collision_rate", "timeout_rate", "failures"),
        *("planner_ms_p50", "elevation_gradient_m", "n", "ci95", "paper", "goal_distance"),
    }
    # What older journals do not say was the random suite, with observers known and exposure not measured.
    assert (row["suite"], row["observers"], row["exposed_s"]) == ("random", "known", None)


def test_the_papers_figures_stand_beside_drives_like_its_own():
    forest = {"terrain": "forest", "method": "covernav"}
    rows = tabulate([mission(0), mission(1, **forest), mission(2, method="least_cost")])
    paper = {(row["terrain"], row["method"]): row["paper"] for row in rows}
    assert paper[("normal", "dwa")] == {
        "success_rate": 0.72,
        "trajectory_length_m": 5.0,
        "execution_time_s": 12.0,
    }
    assert paper[("forest", "covernav")]["success_rate"] == 0.86
    assert paper[("normal", "least_cost")] is None
    (far,) = tabulate([mission(0, goal_distance=50.0)])
    (baseline,) = tabulate([mission(0, terrain="forest")])
    assert far["paper"] is None and baseline["paper"] is None


@pytest.mark.parametrize("fields", [{"suite": "crossing"}, {"perception": "oracle"}])
def test_the_papers_figures_do_not_stand_beside_other_drives(fields):
    (plain,) = tabulate([mission(0, method="covernav")])
    (other,) = tabulate([mission(0, method="covernav", **fields)])
    assert plain["paper"] is not None and other["paper"] is None


def test_avoidable_seconds_are_those_of_all_missions_together():
    seen = [
        mission(0, exposed_s=4.0, shortest_s=10.0, bound_s=2.0),
        mission(1, exposed_s=3.0, shortest_s=4.0, bound_s=2.0),
        mission(2, "collided", exposed_s=0.0, shortest_s=50.0, bound_s=0.0),
        mission(3, exposed_s=5.0, shortest_s=None, bound_s=None),
    ]
    (row,) = tabulate(seen)
    assert row["avoidable_removed"] == pytest.approx((6.0 + 1.0) / (8.0 + 2.0))
    assert row["n"]["avoidable_removed"] == 2
    (nothing,) = tabulate([mission(0, exposed_s=1.0, shortest_s=1.0, bound_s=1.0)])
    assert nothing["avoidable_removed"] is None and nothing["ci95"]["avoidable_removed"] is None


def test_the_share_removed_says_how_sure_it_is():
    alike = [mission(seed, exposed_s=4.0, shortest_s=10.0, bound_s=2.0) for seed in range(8)]
    seen = {"shortest_s": 10.0, "bound_s": 2.0}
    unlike = [mission(seed, exposed_s=2.0 + 8.0 * (seed % 2), **seen) for seed in range(8)]
    (sure,), (unsure,), (again,) = tabulate(alike), tabulate(unlike), tabulate(reversed(unlike))
    assert sure["ci95"]["avoidable_removed"] == pytest.approx([0.75, 0.75])
    low, high = unsure["ci95"]["avoidable_removed"]
    assert 0.0 <= low < 0.25 and 0.75 < high <= 1.0
    assert again["ci95"]["avoidable_removed"] == [low, high]


def test_the_bound_counts_each_mission_once_whoever_drove_it():
    engine = {"shortest_m": 12.0, "shortest_s": 8.0, "bound_m": 15.0}
    drives = [
        mission(seed, method=name, **engine, bound_s=float(seed))
        for name in ("dwa", "route")
        for seed in (1, 3)
    ]
    blocked = {"shortest_m": None, "shortest_s": None, "bound_m": None, "bound_s": None}
    (row,) = bounds([*drives, mission(5, **blocked), mission(6)])
    assert (row["missions"], row["bound_s"], row["bound_m"], row["terrain"]) == (2, 2.0, 15.0, "normal")
    assert "method" not in row


def test_kinds_of_missions_have_rows_of_their_own():
    missions = [
        mission(0),
        mission(0, suite="covert"),
        mission(0, suite="covert", observers="unknown"),
        mission(0, goal_distance=50.0),
    ]
    assert [(row["suite"], row["observers"], row["goal_distance"]) for row in tabulate(missions)] == [
        ("covert", "known", 12.0),
        ("covert", "unknown", 12.0),
        ("random", "known", 12.0),
        ("random", "known", 50.0),
    ]
    assert len(bounds(missions)) == 4


def test_the_order_of_finishing_does_not_change_the_table():
    missions = [mission(seed, terrain=terrain) for seed in range(4) for terrain in ("forest", "normal")]
    assert tabulate(missions) == tabulate(missions[::-1])
    assert [row["terrain"] for row in tabulate(missions)] == ["normal", "forest"]


def test_methods_stand_as_they_are_usually_compared():
    names = [*COMPARED, "zigzag"]
    rows = tabulate([mission(0, method=name) for name in sorted(names)])
    assert [row["method"] for row in rows] == names


def test_errors_of_ours_are_failures_with_their_reason():
    broken = {"status": "error", "success": False, "reason": "its worker process was killed 3 times"}
    missions = [mission(0), mission(1) | broken]
    (row,) = tabulate(missions)
    assert row["success_rate"] == 0.5 and row["failures"] == {"error": 1}
    assert reasons(missions) == {"its worker process was killed 3 times": 1}


def test_totals_are_over_all_terrains_and_every_mission_once():
    seen = {"shortest_s": 9.0, "shortest_m": 12.0, "bound_m": 14.0}
    missions = [
        mission(seed, status, terrain=terrain, method=method, exposed_s=exposed, bound_s=bound, **seen)
        for terrain, seed, status, exposed, bound in (
            ("normal", 0, "reached", 4.0, 3.0), ("normal", 1, "stuck", 5.0, 2.0),
            ("forest", 0, "reached", 6.0, 1.0),
        )
        for method in ("dwa", "covernav")
    ]  # fmt: skip
    rows, (bound,) = totals(missions)
    assert [row["terrain"] for row in rows] == [ALL_TERRAINS] * 2
    assert [row["method"] for row in rows] == ["dwa", "covernav"]
    for row in rows:
        assert row["missions"] == 3 and row["successes"] == 2 and row["failures"] == {"stuck": 1}
        assert row["exposed_s"] == 5.0 and row["paper"] is None
        assert row["avoidable_removed"] == pytest.approx((5.0 + 3.0) / (6.0 + 8.0))
    assert bound["terrain"] == ALL_TERRAINS and bound["missions"] == 3 and bound["bound_s"] == 2.0


def test_one_terrain_has_no_totals():
    assert totals([mission(0), mission(1)]) == ([], [])
