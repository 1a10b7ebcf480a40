"""Planning with the observers that are known, and heeding those that may be there."""

import pickle

import numpy as np
import pytest
from field import field, thing

from planner.frames import Perception, Status
from planner.methods.wary import BELIEF_STRIDE, BelievingPlanner
from scenes.scenario import Observer

WALL = tuple(
    thing(n + 1, x=-4.0 + 2.0 * n, y=-2.5, length=2.2, width=0.8, height=1.4) for n in range(5)
)
SCREEN = thing(9, "building", x=0.0, y=6.5, length=14.0, width=2.0, height=3.0)
START, GOAL = (-8.0, 0.0), (8.0, 0.0)


def watched(known: bool, cover=WALL):
    """A row of rocks along the way, and somebody who watches it from the north."""
    watcher = Observer(id=1, x=0.0, y=9.0, yaw=-90.0, fov_horizontal=140.0, known=known)
    return field(GOAL, cover, observers=(watcher,), start=START)


@pytest.mark.parametrize(
    ("method", "known"), [("route_known", True), ("route_known", False), ("route_wary", False)]
)
def test_it_goes_behind_the_wall_of_a_watcher_it_knows_or_spots(mission, method, known):
    """The watcher is in plain view from the start, so that not being told of it makes no difference."""
    frames = list(mission(watched(known), method, 0, Perception.ORACLE).frames())
    assert frames[-1].status is Status.REACHED and frames[0].percept.known_observers == (1,)
    assert min(frame.pose.y for frame in frames) < -2.5


def test_of_whom_it_does_not_know_it_does_not_hide(mission):
    first = mission(watched(False, (*WALL, SCREEN)), "route_known", 0, Perception.ORACLE).tick()
    assert first.percept.known_observers == () and np.abs(first.decision.route[:, 1]).max() < 0.5


def test_ground_that_somebody_not_yet_seen_may_see_is_avoided():
    heightmap = field().terrain.heightmap()
    careless, wary = (BelievingPlanner(heightmap, WALL, ()) for _ in range(2))
    cells = len(range((BELIEF_STRIDE - 1) // 2, heightmap.shape[0], BELIEF_STRIDE))
    wary.belief = np.zeros((cells, cells), np.float32)
    wary.belief[cells // 2 - 4 :, cells // 3 : -cells // 3] = 0.4  # the middle, and north of it
    straight, around = (planner.route(START, GOAL, 0.9).points for planner in (careless, wary))
    assert np.abs(straight[:, 1]).max() < 0.5 and around[:, 1].min() < -2.0


def test_the_belief_is_a_layer_of_the_decision(mission):
    wary, careless = (
        mission(watched(False, (*WALL, SCREEN)), method, 0, Perception.ORACLE).tick().decision
        for method in ("route_wary", "route_known")
    )
    assert careless.belief is None
    cost = wary.belief.cost
    assert wary.belief.resolution == 0.75 and cost.shape == (32, 32) and 0.0 < cost.max() <= 40.0
    assert wary.belief.x_min == pytest.approx(-11.75)


def test_a_mission_goes_on_from_a_snapshot(mission):
    drive = mission(watched(False), "route_wary", 0, Perception.ORACLE)
    for _ in range(15):
        drive.tick()
    snapshot = pickle.loads(pickle.dumps(drive.snapshot()))
    again = mission(drive.scenario, "route_wary", 0, Perception.ORACLE, snapshot=snapshot)
    assert list(again.frames())[-1].status is Status.REACHED


def test_a_new_goal_makes_a_new_route(mission):
    drive = mission(watched(True), "route_wary", 0, Perception.ORACLE)
    drive.tick()
    drive.set_goal(-8.0, 8.0)
    route = drive.tick().decision.route
    assert np.hypot(*(route[-1] - (-8.0, 8.0))) < 0.3
