"""How far the robot rolls on by its data sheet, and that the driver heeds what it is told of that."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maps import drive, grid_map, percept
from scenes_to_hide_in import flat

from planner.braking import LevelBraking
from planner.cost_map import CostConfig, ground_near
from planner.driver import Driver
from planner.methods.covernav import CoverNav
from planner.methods.least_cost import LeastCost
from scenes.physics import World
from scenes.pose import Pose, Twist
from scenes.robot import HUSKY
from scenes.scenario import Start


@given(st.floats(-1.0, 1.0))
def test_it_rolls_on_as_long_as_it_takes_to_slow_down(v):
    (way,) = LevelBraking().ways(Pose(0.0, 0.0, 0.0), Twist(v, 0.0))
    assert way == pytest.approx(max(v, 0.0) ** 2 / (2.0 * HUSKY.max_acceleration))


@pytest.mark.parametrize("speed", [0.3, 0.6, 1.0])
def test_the_husky_does_on_level_ground(speed):
    with World(flat(), start=Start(x=-5.0, y=0.0)) as world:
        for _ in range(12):
            world.step(Twist(speed, 0.0), 0.1)
        begin, twist = world.pose, world.twist
        for _ in range(10):
            world.step(Twist(), 0.1)
        rolled = world.pose.x - begin.x
    assert LevelBraking().ways(begin, twist)[0] == pytest.approx(rolled, abs=0.06)


def test_covernav_brakes_late_and_least_cost_gently():
    assert isinstance(CoverNav().driver.stopping, LevelBraking)
    assert LeastCost().driver.stopping is None


class AtOnce:
    """A robot that stops within so many metres."""

    def __init__(self, *ways: float):
        self._ways = np.array(ways)

    def ways(self, pose, twist):
        return self._ways


def arrives(driver, goal=(6.0, 0.0)):
    def decide(now):
        return driver.drive(now, now.goal, ground_near(now.grid, now.pose.x, now.pose.y, 3.2, CostConfig()))

    return drive(decide, grid_map(), Pose(0.0, 0.0, 0.0), goal)


def test_the_driver_that_knows_how_it_stops_arrives_sooner():
    gentle, knowing = arrives(Driver()), arrives(Driver(stopping=AtOnce(0.0, 0.05)))
    assert len(knowing) <= len(gentle) - 3
    now, driven = knowing[-1]
    assert now.goal_distance < 0.3 and driven.command == Twist()


def test_it_does_not_stop_where_it_would_come_to_rest_too_far_from_the_goal():
    driver = Driver(stopping=AtOnce(0.3, 0.9))  # nobody knows whether here or there
    assert not any(driven.note == "stopping at the goal" for _, driven in arrives(driver))
    passing = percept(grid_map(), Pose(0.0, 0.0, 0.0), (0.3, 0.5), Twist(1.0, 0.0))
    far = Driver(stopping=AtOnce(0.3, 0.3)).drive(
        passing, passing.goal, ground_near(passing.grid, 0.0, 0.0, 3.2, CostConfig())
    )
    assert far.note != "stopping at the goal"
