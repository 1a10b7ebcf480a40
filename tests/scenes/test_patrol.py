"""Walkers on their beats."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.patrol import patrol_pose

SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]


@pytest.mark.parametrize(
    ("loop", "time_s", "expected"),
    [
        (True, 0.0, (0.0, 0.0, 0.0)),
        (True, 1.0, (2.0, 0.0, 0.0)),
        (True, 3.0, (4.0, 2.0, math.pi / 2)),
        (True, 7.0, (0.0, 2.0, -math.pi / 2)),
        (True, 9.0, (2.0, 0.0, 0.0)),
        (False, 5.0, (2.0, 4.0, math.pi)),
        (False, 7.0, (2.0, 4.0, 0.0)),
        (False, 11.0, (2.0, 0.0, math.pi)),
    ],
)
def test_a_beat_closes_or_turns_back(loop, time_s, expected):
    assert patrol_pose(SQUARE, 2.0, loop, 0.3, time_s) == pytest.approx(expected)


@pytest.mark.parametrize("waypoints", [[(1.0, 2.0)], [(1.0, 2.0), (1.0, 2.0)]])
def test_one_who_has_nowhere_to_go_keeps_his_facing(waypoints):
    assert patrol_pose(waypoints, 2.0, True, 0.3, 5.0) == (1.0, 2.0, 0.3)


points = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))


@given(
    waypoints=st.lists(points, min_size=2, max_size=6),
    speed=st.floats(0.05, 20.0),
    loop=st.booleans(),
    time_s=st.floats(0.0, 1000.0),
)
def test_nobody_is_faster_than_his_speed(waypoints, speed, loop, time_s):
    x, y, _ = patrol_pose(waypoints, speed, loop, 0.0, time_s)
    later_x, later_y, _ = patrol_pose(waypoints, speed, loop, 0.0, time_s + 0.1)
    assert math.dist((x, y), (later_x, later_y)) <= 0.1 * speed + 1e-6
