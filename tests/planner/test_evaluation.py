"""Tables: intervals are Wilson's, rows say why drives failed, finished missions are not driven twice."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import evaluation
from planner.evaluation import evaluate, specs, tabulate, wilson
from planner.frames import Perception
from planner.suites import Suite
from scenes.scenario import Family


def test_wilson_matches_published_values():
    # Newcombe 1998, Statistics in Medicine 17, table I, method 3: 81/263 and 15/148
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_holds_the_rate_and_stays_within_bounds(case):
    successes, trials = case
    low, high = wilson(successes, trials)
    assert 0.0 <= low <= successes / trials + 1e-12 and successes / trials - 1e-12 <= high <= 1.0
    assert low < high


def mission(seed: int, status: str = "reached", **fields):
    return {
        "terrain": "normal",
        "method": "dwa",
        "perception": "lidar",
        "seed": seed,
        "goal_distance": 12.0,
        "status": status,
        "success": status == "reached",
        "trajectory_length_m": 12.0,
        "straight_line_m": 10.0,
        "execution_time_s": 20.0,
        "cover_fraction": 0.5,
        "planner_ms_p50": 9.0,
    } | fields


def test_a_row_counts_the_reasons_of_failure_and_means_successes_alone():
    missions = [mission(0), mission(1, "collided", trajectory_length_m=99.0), mission(2, "timeout")]
    (row,) = tabulate(missions)
    assert row["missions"] == 3 and row["successes"] == 1
    assert row["success_rate"] == pytest.approx(1 / 3)
    assert row["failures"] == {"collided": 1, "timeout": 1}
    assert row["collision_rate"] == row["timeout_rate"] == pytest.approx(1 / 3)
    assert row["trajectory_length_m"] == 12.0 and row["length_ratio"] == pytest.approx(1.2)


def test_means_over_no_success_are_left_out():
    (row,) = tabulate([mission(0, "stuck")])
    assert row["trajectory_length_m"] is None and not math.isnan(row["success_rate"])


def test_a_row_has_the_keys_that_others_rely_on():
    (row,) = tabulate([mission(0)])
    assert list(row) == [
        *("terrain", "method", "suite", "observers", "perception", "missions", "successes", "success_rate"),
        *("success_ci95", "trajectory_length_m", "length_ratio", "execution_time_s", "exposure_fraction"),
        *("exposed_s", "longest_exposure_s", "detection_probability", "avoidable_removed"),
        *("cover_fraction", "concealed_fraction", "collision_rate", "timeout_rate", "failures"),
        "planner_ms_p50",
    ]
    # What older journals do not say was the random suite, with observers known and exposure not measured.
    assert (row["suite"], row["observers"], row["exposed_s"]) == ("random", "known", None)


def test_avoidable_seconds_are_those_of_all_missions_together():
    seen = [
        mission(0, exposed_s=4.0, shortest_s=10.0, bound_s=2.0),
        mission(1, exposed_s=3.0, shortest_s=4.0, bound_s=2.0),
        mission(2, "collided", exposed_s=0.0, shortest_s=50.0, bound_s=0.0),
        mission(3, exposed_s=5.0, shortest_s=None, bound_s=None),
    ]
    (row,) = tabulate(seen)
    assert row["avoidable_removed"] == pytest.approx((6.0 + 1.0) / (8.0 + 2.0))
    (nothing,) = tabulate([mission(0, exposed_s=1.0, shortest_s=1.0, bound_s=1.0)])
    assert nothing["avoidable_removed"] is None


def test_suites_and_what_is_known_have_rows_of_their_own():
    missions = [mission(0), mission(0, suite="covert"), mission(0, suite="covert", observers="unknown")]
    assert [(row["suite"], row["observers"]) for row in tabulate(missions)] == [
        ("covert", "known"),
        ("covert", "unknown"),
        ("random", "known"),
    ]


def test_the_order_of_finishing_does_not_change_the_table():
    missions = [mission(seed, terrain=terrain) for seed in range(4) for terrain in ("forest", "normal")]
    assert tabulate(missions) == tabulate(missions[::-1])
    assert [row["terrain"] for row in tabulate(missions)] == ["normal", "forest"]


@pytest.fixture
def wanted():
    return specs(["dwa"], [Family.NORMAL], 4, 10, Perception.LIDAR, 12.0)


def test_every_method_gets_the_same_seeds():
    both = specs(["dwa", "least_cost"], [Family.LOW], 3, 5, Perception.LIDAR, 12.0)
    by_method = {name: [s.seed for s in both if s.method == name] for name in ("dwa", "least_cost")}
    assert by_method["dwa"] == by_method["least_cost"] == [5, 6, 7]


def test_finished_missions_are_taken_from_the_journal(tmp_path, wanted, monkeypatch):
    journal = tmp_path / "missions.jsonl"
    kept = [mission(spec.seed) for spec in wanted[:3]]
    journal.write_text("".join(json.dumps(m) + "\n" for m in kept) + '{"terrain": "nor')  # cut off
    monkeypatch.setattr(evaluation, "drive", lambda spec: mission(spec.seed, "stuck"))
    results = list(evaluate(wanted, 1, journal))
    assert [m["status"] for m in results] == ["reached"] * 3 + ["stuck"]
    assert len(journal.read_text().splitlines()) == 4
    assert list(evaluate(wanted, 1, journal)) == results


def test_a_journal_keeps_suites_apart(tmp_path, monkeypatch):
    journal = tmp_path / "missions.jsonl"
    kept = [mission(10, suite="covert", observers="known")]
    journal.write_text("".join(json.dumps(m) + "\n" for m in kept))
    driven = []
    monkeypatch.setattr(
        evaluation, "drive", lambda spec: driven.append(spec) or mission(spec.seed, suite=str(spec.suite))
    )
    for suite in Suite:
        list(evaluate(specs(["dwa"], [Family.NORMAL], 1, 10, Perception.LIDAR, 12.0, suite), 1, journal))
    assert [spec.suite for spec in driven] == [Suite.RANDOM]


def test_a_journal_of_something_else_is_refused(tmp_path, wanted):
    journal = tmp_path / "missions.jsonl"
    journal.write_text("hello\n")
    with pytest.raises(ValueError, match="line 1"):
        list(evaluate(wanted, 1, journal))
    assert journal.read_text() == "hello\n"
