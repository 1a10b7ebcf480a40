"""What somebody who watches a walk remembers of it, and what that tells of how it goes on."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.walks import FEATURES, PLACES, STEP, Walks
from scenes.patrol import patrol_pose

BEAT = [(0.0, 0.0), (6.0, 0.0)]


def watched(waypoints, speed, seconds, loop=False, begun_s=0.0, hidden=lambda t: False) -> Walks:
    """A walk along waypoints, seen every half second but where hidden."""
    walk = Walks.unseen(np.zeros(1, bool))
    for t in np.arange(0.0, seconds + 1e-9, STEP):
        x, y, yaw = patrol_pose(waypoints, speed, loop, 0.0, begun_s + t)
        velocity = speed * np.array([[math.cos(yaw), math.sin(yaw)]])
        walk.see(np.array([t]), np.array([[x, y]]), velocity, np.array([not hidden(t)]))
    return walk


def feature(walk, name) -> float:
    return float(walk.features()[0, FEATURES.index(name)])


def test_speed_and_way_since_it_was_first_seen():
    walk = watched(BEAT, 1.2, 3.0)
    assert walk.speed[0] == pytest.approx(1.2)
    assert walk.walked[0] == pytest.approx(3.6)
    assert not walk.begun[0] and walk.count[0] == 0
    assert np.isinf(walk.ahead()[0][0])


@given(st.floats(0.4, 3.4), st.floats(0.0, 30.0))
def test_a_turn_is_remembered_where_it_was(speed, begun_s):
    walk = watched([(0.0, 0.0), (14.0, 0.0)], speed, 60.0, begun_s=begun_s)
    known = walk.places[0][~np.isnan(walk.places[0, :, 0])]
    near = np.minimum(np.abs(known[:, 0]), np.abs(known[:, 0] - 14.0))
    assert len(known) <= 2 and (near < 1e-6).all() and np.abs(known[:, 1]).max(initial=0.0) < 1e-6


def test_it_comes_to_where_it_turned_before_and_turns_there_as_then():
    walk = watched(BEAT, 1.0, 16.0)  # to the far end, back, and four metres on
    metres, turn = walk.ahead()
    assert metres[0] == pytest.approx(2.0) and abs(turn[0]) == pytest.approx(math.pi)
    assert walk.last_leg[0] == pytest.approx(6.0)
    assert feature(walk, "steps_to_place") == pytest.approx(1.0)
    near = watched(BEAT, 1.0, 17.5)
    assert feature(near, "steps_to_place") == pytest.approx(0.25)


def test_on_its_way_back_it_undoes_its_turns():
    corner = [(0.0, 0.0), (6.0, 0.0), (6.0, 8.0)]
    walk = watched(corner, 1.0, 17.0)  # at (6, 5), heading south
    metres, turn = walk.ahead()
    assert metres[0] == pytest.approx(5.0) and turn[0] == pytest.approx(math.radians(90.0) * -1.0)


def test_round_a_loop_it_turns_as_it_did():
    square = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]
    walk = watched(square, 1.0, 17.0, loop=True)
    metres, turn = walk.ahead()
    assert metres[0] == pytest.approx(3.0) and turn[0] == pytest.approx(math.radians(90.0))


def test_after_a_gap_nobody_knows_where_its_leg_began_but_the_turns_are_remembered():
    walk = watched(BEAT, 1.0, 16.0, hidden=lambda t: 8.0 < t < 13.0)
    assert walk.walked[0] == pytest.approx(3.0) and not walk.begun[0]
    assert walk.ahead()[0][0] == pytest.approx(2.0)


def test_who_stands_keeps_its_heading():
    walk = watched(BEAT, 1.0, 3.0)
    walk.see(np.array([3.5]), walk.position.copy(), np.array([[0.0, -0.05]]), np.ones(1, bool))
    assert walk.heading[0] == pytest.approx(0.0) and walk.count[0] == 0


def test_ways_that_are_let_go_on_turn_and_remember_it():
    ways = watched(BEAT, 1.0, 3.0).repeated(2)
    ways.go(STEP, np.array([math.nan, math.pi]))
    np.testing.assert_allclose(ways.position[:, 0], 3.5)
    ways.go(STEP, np.full(2, math.nan))
    np.testing.assert_allclose(ways.position[:, 0], [4.0, 3.0])
    np.testing.assert_array_equal(ways.count, [0, 1])
    assert ways.walked[0] == pytest.approx(4.0) and ways.walked[1] == pytest.approx(0.5)


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=5), st.booleans())
def test_features_are_finite_and_of_the_order_of_one(waypoints, loop):
    walk = watched(waypoints, 1.0, 40.0, loop)
    features = walk.features()
    assert features.shape == (1, len(FEATURES)) and features.dtype == np.float32
    assert np.isfinite(features).all() and np.abs(features).max() <= 2.0
    assert walk.count[0] <= 80 and walk.places.shape == (1, PLACES, 2)
