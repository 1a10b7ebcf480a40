"""Paired differences: the same missions, and nothing else, are compared."""

import pytest
from drives import mission

from planner.paired import paired


def pair(seed, ours, theirs, **fields):
    here = {"exposed_s": ours, "max_roll_deg": 4.0, "max_pitch_deg": 1.0} | fields
    there = {"exposed_s": theirs, "max_roll_deg": 1.0, "max_pitch_deg": 2.0} | fields
    return [mission(seed, method="covernav", **here), mission(seed, method="dwa", **there)]


def test_differences_are_those_of_each_seeds_pair():
    drives = [*pair(0, 2.0, 5.0), *pair(1, 1.0, 5.0), *pair(2, 3.0, 8.0), mission(9, exposed_s=99.0)]
    (row,) = paired(drives, "covernav", "dwa")
    assert (row["terrain"], row["method"], row["against"]) == ("normal", "covernav", "dwa")
    assert row["missions"] == 3
    assert row["exposed_s"]["n"] == 3 and row["exposed_s"]["difference"] == pytest.approx(-4.0)
    # t(0.975, 2) = 4.3027 on differences -3, -4, -5
    half = 4.3027 / 3**0.5
    assert row["exposed_s"]["ci95"] == pytest.approx([-4.0 - half, -4.0 + half], abs=1e-3)
    assert row["max_tilt_deg"]["difference"] == pytest.approx(2.0)


def test_what_a_failed_drive_was_seen_is_not_compared():
    drives = [*pair(0, 2.0, 5.0), *pair(1, 1.0, 5.0)]
    drives[2] |= {"status": "collided", "success": False, "exposed_s": 0.0}
    (row,) = paired(drives, "covernav", "dwa")
    assert row["exposed_s"] == {"n": 1, "difference": -3.0, "ci95": None}
    assert row["success"]["n"] == 2 and row["success"]["difference"] == -0.5
    assert row["max_tilt_deg"]["n"] == 2


def test_terrains_have_a_row_each_and_one_together():
    drives = [*pair(0, 2.0, 5.0), *pair(0, 1.0, 2.0, terrain="forest")]
    rows = paired(drives, "covernav", "dwa")
    assert [(row["terrain"], row["missions"]) for row in rows] == [("normal", 1), ("forest", 1), ("all", 2)]
    assert rows[-1]["exposed_s"]["difference"] == pytest.approx(-2.0)


def test_suites_are_not_mixed():
    drives = [*pair(0, 2.0, 5.0), *pair(0, 1.0, 2.0, suite="covert")]
    assert [row["suite"] for row in paired(drives, "covernav", "dwa")] == ["covert", "random"]


def test_methods_that_never_met_have_no_rows():
    assert paired([mission(0), mission(1, method="covernav")], "covernav", "dwa") == []
