"""Planning with the observers that are known, and heeding those that may be there."""

import pickle

import numpy as np
import pytest

from planner.frames import Perception, Status
from planner.methods.wary import BELIEF_STRIDE, BelievingPlanner
from planner.mission import Mission
from scenes.scenario import CoverObject, GeneratedSource, Observer, Point, Scenario, Start, Terrain

CELLS = 97


def field(known: bool, **changes) -> Scenario:
    """A meadow of 24 m with a row of rocks along the way, and somebody who watches it from the north."""
    wall = [
        CoverObject(id=n + 1, kind="rock", x=-4.0 + 2.0 * n, y=-2.5, length=2.2, width=0.8, height=1.4)
        for n in range(5)
    ]
    watcher = Observer(id=1, x=0.0, y=9.0, yaw=-90.0, fov_horizontal=140.0, known=known)
    fields = {
        "version": 1,
        "name": "wall",
        "terrain": Terrain(
            resolution=0.25,
            heights=np.zeros((CELLS, CELLS)),
            surface=("g" * CELLS,) * CELLS,
            source=GeneratedSource(family="normal", seed=0),
        ),
        "start": Start(x=-8.0, y=0.0),
        "goal": Point(x=8.0, y=0.0),
        "cover": tuple(wall),
        "observers": (watcher,),
    }
    return Scenario(**(fields | changes))


@pytest.fixture
def mission():
    made = []

    def make(*arguments, **keywords) -> Mission:
        made.append(Mission(*arguments, **keywords))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize(
    ("method", "known"), [("route_known", True), ("route_known", False), ("route_wary", False)]
)
def test_it_goes_behind_the_wall_of_a_watcher_it_knows_or_spots(mission, method, known):
    """The watcher is in plain view from the start, so that not being told of it makes no difference."""
    frames = list(mission(field(known), method, 0, Perception.ORACLE).frames())
    assert frames[-1].status is Status.REACHED and frames[0].percept.known_observers == (1,)
    assert min(frame.pose.y for frame in frames) < -2.5


def test_of_whom_it_does_not_know_it_does_not_hide(mission):
    far = Observer(id=1, x=0.0, y=9.0, yaw=-90.0, known=False)
    screen = CoverObject(id=9, kind="building", x=0.0, y=6.5, length=14.0, width=2.0, height=3.0)
    scenario = field(False, observers=(far,), cover=(*field(False).cover, screen))
    drive = mission(scenario, "route_known", 0, Perception.ORACLE)
    first = drive.tick()
    assert first.percept.known_observers == () and np.abs(first.decision.route[:, 1]).max() < 0.5


def test_ground_that_somebody_not_yet_seen_may_see_is_avoided():
    scenario = field(False, observers=())
    planner = BelievingPlanner(scenario.terrain.heightmap(), scenario.cover, ())
    start, goal = (-8.0, 0.0), (8.0, 0.0)
    straight = planner.bound(start, goal)
    fearful = BelievingPlanner(scenario.terrain.heightmap(), scenario.cover, ())
    side = len(range((BELIEF_STRIDE - 1) // 2, CELLS, BELIEF_STRIDE))
    fearful.belief = np.zeros((side, side), np.float32)
    fearful.belief[side // 2 - 4 :, side // 3 : -side // 3] = 0.4  # the middle, and north of it
    wary = fearful.route(start, goal, 0.9)
    assert np.abs(straight.points[:, 1]).max() < 0.5 and wary.points[:, 1].min() < -2.0


def test_a_mission_goes_on_from_a_snapshot(mission):
    drive = mission(field(False), "route_wary", 0, Perception.ORACLE)
    for _ in range(15):
        drive.tick()
    snapshot = pickle.loads(pickle.dumps(drive.snapshot()))
    again = mission(drive.scenario, "route_wary", 0, Perception.ORACLE, snapshot=snapshot)
    assert list(again.frames())[-1].status is Status.REACHED


def test_a_new_goal_makes_a_new_route(mission):
    drive = mission(field(True), "route_wary", 0, Perception.ORACLE)
    drive.tick()
    drive.set_goal(-8.0, 8.0)
    route = drive.tick().decision.route
    assert np.hypot(*(route[-1] - (-8.0, 8.0))) < 0.3
