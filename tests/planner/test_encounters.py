"""Where the robot would meet those who walk or drive about."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maps import grid_map, percept

from planner.encounters import REACH, meeting_chance
from planner.foresight import TrackLog, straight_on
from planner.frames import TrackedObstacle
from planner.pace import seconds_to
from scenes.pose import Pose
from scenes.scenario import ObstacleKind

HERE = Pose(0.0, 0.0, 0.0)


def person(x, y, vx=0.0, vy=0.0, number=1) -> TrackedObstacle:
    return TrackedObstacle(number, ObstacleKind.PERSON, x, y, vx, vy, 0.25)


def chance(*moving, foresight=straight_on):
    grid = grid_map()
    found = meeting_chance(percept(grid, HERE, moving=moving), foresight)
    return lambda x, y: float(found[grid.cell(x, y)])


def test_nobody_is_met_where_nobody_is() -> None:
    grid = grid_map()
    assert not meeting_chance(percept(grid, HERE), straight_on).any()


def test_who_stands_is_met_where_it_stands() -> None:
    at = chance(person(2.0, 0.0))
    assert at(2.0, 0.0) == pytest.approx(1.0, abs=0.02)
    assert at(2.0, 2.5) == 0.0


def test_who_walks_is_met_where_both_come_at_the_same_time() -> None:
    crossing = float(seconds_to(HERE, np.array(3.0), np.array(0.0)))
    at = chance(person(3.0, -crossing, vy=1.0))
    assert at(3.0, 0.0) > 0.95
    assert at(3.0, -3.5) < 0.2  # it has gone from there
    assert chance(person(3.0, -3.0 * crossing, vy=1.0))(3.0, 0.0) < 0.05  # and comes there much later


def test_ways_that_are_as_likely_share_the_chance() -> None:
    def either(obstacle, track, times):
        return np.array([[(2.0, 0.0, 0.0), (-2.0, 0.0, 0.0)]] * len(times))

    at = chance(person(0.0, 3.0), foresight=either)
    assert at(2.0, 0.0) == pytest.approx(0.5, abs=0.02) and at(-2.0, 0.0) == pytest.approx(0.5, abs=0.02)


@given(st.floats(-8, 8), st.floats(-8, 8), st.floats(-3, 3), st.floats(-3, 3))
def test_it_is_a_chance_and_ends_at_the_reach(x, y, vx, vy) -> None:
    grid = grid_map()
    found = meeting_chance(percept(grid, HERE, moving=(person(x, y, vx, vy),)), straight_on)
    assert found.shape == grid.shape and found.min() >= 0.0 and found.max() <= 1.0
    rows, cols = np.indices(grid.shape)
    away = np.hypot(grid.x_min + 0.2 * cols, grid.y_min + 0.2 * rows)
    assert not found[away > REACH].any()


def test_a_track_is_remembered_every_half_second_and_its_newest_sighting_always() -> None:
    log = TrackLog()
    for tick in range(13):
        log.see(0.1 * tick, [person(0.1 * tick, 0.0, vx=1.0)])
    track = log.tracks([person(1.2, 0.0)])[1]
    np.testing.assert_allclose(track[:, 0], [0.0, 0.5, 1.0, 1.2], atol=1e-9)
    np.testing.assert_allclose(track[:, 1], track[:, 0], atol=1e-9)
    log.see(0.5, [person(9.0, 0.0)])  # the clock was set back
    np.testing.assert_allclose(log.tracks([person(9.0, 0.0)])[1][:, :2], [[0.0, 0.0], [0.5, 9.0]])


def test_straight_on_is_at_the_present_velocity_for_ever() -> None:
    poses = straight_on(person(1.0, 2.0, 0.5, -1.0), np.array([[4.0, 1.0, 2.0, 0.5, -1.0]]), [4.0, 6.0])
    np.testing.assert_allclose(poses[:, 0, :2], [[1.0, 2.0], [2.0, 0.0]])
    np.testing.assert_allclose(poses[:, 0, 2], math.atan2(-1.0, 0.5))
