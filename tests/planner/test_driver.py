"""Driving to a point: slowing down, stopping, and getting free where nothing is admissible."""

import math

import numpy as np
import pytest
from maps import drive, grid_map, percept

from planner.cost_map import CostConfig, ground_near
from planner.driver import Driver, State
from planner.driver_config import DriverConfig
from planner.dwa import Slip
from planner.frames import TrackedObstacle
from scenes.pose import Pose, Twist, wrap_angle
from scenes.scenario import ObstacleKind

ORIGIN = Pose(0.0, 0.0, 0.0)


def toward_goal(driver):
    """Decide with the goal itself for a target."""

    def decide(now):
        ground = ground_near(now.grid, now.pose.x, now.pose.y, 3.2, CostConfig())
        return driver.drive(now, now.goal, ground)

    return decide


def distances(log):
    return np.array([now.goal_distance for now, _ in log])


@pytest.mark.parametrize("yaw", [0.0, 1.2, -2.0, math.pi])
def test_reaches_the_goal_from_any_heading_and_stands_there(yaw):
    log = drive(toward_goal(Driver()), grid_map(), Pose(0.0, 0.0, 0.0, yaw=yaw))
    assert len(log) < 200
    assert distances(log)[-1] < 0.35


def test_slows_down_before_the_goal_without_passing_it():
    log = drive(toward_goal(Driver()), grid_map(), ORIGIN)
    speed = np.array([driven.command.v for _, driven in log])
    assert speed.max() == pytest.approx(1.0)
    assert (speed[distances(log) < 0.5] < 0.75).all()
    assert (np.diff(distances(log)) < 1e-6).all()


def test_says_how_far_it_has_to_go():
    driven = toward_goal(Driver())(percept(grid_map(), ORIGIN))
    assert driven.note == "driving to the goal, 6.0 m left"


def test_goes_around_something_small():
    grid = grid_map(blocked=lambda x, y: np.hypot(x - 3.0, y - 0.1) < 0.4)
    log = drive(toward_goal(Driver()), grid, ORIGIN)
    assert distances(log)[-1] < 0.35
    gaps = [np.hypot(now.pose.x - 3.0, now.pose.y - 0.1) for now, _ in log]
    assert min(gaps) > 0.4 + 0.335


def test_goes_through_a_passage_a_hand_wider_than_itself():
    grid = grid_map(blocked=lambda x, y: (np.abs(x - 2.0) < 0.6) & (np.abs(y) > 0.55))
    aside = Pose(0.0, 0.6, 0.0)
    assert distances(drive(toward_goal(Driver()), grid, aside))[-1] < 0.35
    # Without boldness it stands before it, where it is the clearest.
    timid = Driver(DriverConfig(boldness=math.inf))
    assert distances(drive(toward_goal(timid), grid, aside))[-1] > 4.0


def test_facing_a_wall_it_says_why_and_looks_for_a_way_around():
    grid = grid_map(blocked=lambda x, y: (np.abs(x - 2.0) < 0.3) & (np.abs(y) < 2.0))
    driver = Driver()
    log = drive(toward_goal(driver), grid, ORIGIN, ticks=200)
    notes = " ".join(driven.note for _, driven in log)
    assert "backing off" in notes and "turning to a free direction" in notes
    assert min(2.0 - 0.3 - now.pose.x for now, _ in log if abs(now.pose.y) < 2.0 and now.pose.x < 2) > 0.5


def test_shut_in_it_gives_up_in_the_end():
    box = grid_map(blocked=lambda x, y: np.maximum(np.abs(x), np.abs(y)) > 1.2)
    log = drive(toward_goal(Driver()), box, ORIGIN, ticks=1500)
    assert log[-1][1].stuck and "stuck" in log[-1][1].note
    assert max(max(abs(now.pose.x), abs(now.pose.y)) for now, _ in log) < 0.8


@pytest.mark.parametrize(("patience", "frees_itself"), [(2, True), (99, False)])
def test_gets_free_from_beside_a_post_that_it_believes_to_slide_into(patience, frees_itself):
    post = grid_map(blocked=lambda x, y: np.hypot(x, y - 0.4) < 0.05)
    beside = Pose(-0.06, -0.09, 0.0)
    driver = Driver(DriverConfig(patient_recoveries=patience))
    driver._slip.slip = Slip(0.0, 0.3)
    log = drive(toward_goal(driver), post, beside, ticks=700)
    assert bool(distances(log)[-1] < 0.35) == frees_itself


def test_turns_to_where_it_is_free_not_to_where_it_was_before():
    corridor = grid_map(blocked=lambda x, y: (np.abs(y) > 1.2) | (x > 1.2))
    driver = Driver()
    now = percept(corridor, ORIGIN)
    first = driver._freest(now, now.goal)
    assert abs(wrap_angle(first - math.pi)) < 0.3
    assert abs(wrap_angle(driver._freest(now, now.goal) - first)) > 0.2


def test_gives_way_to_what_will_cross_its_way():
    def person(time_s):
        return (TrackedObstacle(1, ObstacleKind.PERSON, 2.5, 3.0 - time_s, 0.0, -1.0, 0.3),)

    log = drive(toward_goal(Driver()), grid_map(), ORIGIN, moving=person)
    assert distances(log)[-1] < 0.35
    nearest = min(math.hypot(now.pose.x - 2.5, now.pose.y - (3.0 - now.time_s)) for now, _ in log)
    assert nearest > 0.3 + 0.335


def test_reset_forgets_a_recovery():
    driver = Driver(DriverConfig(blocked_patience=0.0))
    shut = grid_map(blocked=lambda x, y: np.abs(x - 0.7) < 0.1)
    toward_goal(driver)(percept(shut, ORIGIN, twist=Twist(1.0, 0.0)))
    toward_goal(driver)(percept(shut, ORIGIN, twist=Twist(1.0, 0.0), time_s=0.1))
    assert driver.state is not State.DRIVE
    driver.reset()
    assert driver.state is State.DRIVE


def test_learns_how_far_its_middle_swings_when_it_turns():
    driver, grid = Driver(), grid_map()
    yaw = np.linspace(0.0, 3.0, 31)
    for tick in range(31):  # about its rear axle, 0.25 m behind the middle
        pose = Pose(0.25 * math.cos(yaw[tick]), 0.25 * math.sin(yaw[tick]), 0.0, yaw=yaw[tick])
        driven = toward_goal(driver)(percept(grid, pose, goal=(50.0, 0.0), time_s=0.1 * tick))
    turning = np.flatnonzero(driven.arcs.w > 0.3)[0]
    start, end = driven.arcs.poses[turning, 0], driven.arcs.poses[turning, 1]
    step, middle = end - start, 0.5 * (start[2] + end[2])
    left = math.cos(middle) * step[1] - math.sin(middle) * step[0]
    assert left / step[2] == pytest.approx(0.25, abs=0.02)


def test_the_same_percepts_give_the_same_commands():
    grid = grid_map(blocked=lambda x, y: (np.abs(x - 2.0) < 0.3) & (np.abs(y) < 1.0))
    one, two = (
        [driven.command for _, driven in drive(toward_goal(Driver()), grid, ORIGIN, ticks=150)]
        for _ in range(2)
    )
    assert one == two
