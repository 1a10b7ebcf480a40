"""Methods that follow a covert route with everything known."""

import math
import pickle

import numpy as np
import pytest
from scenes_to_hide_in import eye, wall

from planner.frames import Perception, Status
from planner.methods import METHODS, make_method
from planner.methods.route import FollowRoute, _evenly, most_hidden
from planner.mission import Mission
from scenes.scenario import GeneratedSource, Patrol, Point, Scenario, Start, Terrain

ROUTES = [name for name in METHODS if name.startswith("route")]


def scene(cover=(), observers=(), goal=(6.0, 1.5)) -> Scenario:
    """Flat grass, 24 m at half a metre; 12.5 m to drive."""
    return Scenario(
        version=1,
        name="A field with walls",
        terrain=Terrain(
            resolution=0.5,
            heights=np.zeros((49, 49)),
            surface=("g" * 49,) * 49,
            source=GeneratedSource(family="normal", seed=0),
        ),
        start=Start(x=-6.5, y=1.5),
        goal=Point(x=goal[0], y=goal[1]),
        cover=tuple(cover),
        observers=tuple(observers),
    )


def driven(scenario: Scenario, method: str) -> Mission:
    mission = Mission(scenario, method, 0, Perception.ORACLE)
    for _ in mission.frames():
        pass
    mission.close()
    return mission


HIDING = scene([wall(1, 0.0, 0.0, 9.0)], [eye()])


@pytest.fixture(scope="module")
def drives():
    return {name: driven(HIDING, name) for name in ROUTES}


def test_every_route_is_driven_to_its_end(drives):
    assert all(mission.status is Status.REACHED for mission in drives.values())


def test_the_more_hidden_the_route_the_less_is_seen_of_the_drive(drives):
    exposed = {name: mission.summary()["exposed_s"] for name, mission in drives.items()}
    assert exposed["route"] < 0.6 * exposed["route_shortest"]
    assert exposed["route"] <= exposed["route_balanced"] + 0.3


def test_the_drive_is_seen_about_as_long_as_was_planned(drives):
    for name in ("route", "route_shortest"):
        planned = make_method(name)
        with Mission(HIDING, name, 0, Perception.ORACLE) as mission:
            percept = mission.tick().percept
            planned.brief(HIDING, mission._rays)
            route = planned._choose(planned._planner, percept)
        logged = drives[name].summary()["exposed_s"]
        assert logged == pytest.approx(route.exposed_s, abs=1.2), name


def test_the_same_scene_is_driven_the_same(drives):
    again = driven(HIDING, "route")
    assert again.frame.pose == drives["route"].frame.pose


def test_an_edit_bends_the_route():
    with Mission(scene([], [eye()]), "route", 0, Perception.ORACLE) as mission:
        straight = mission.tick().decision.route
        mission.edit(HIDING)
        hidden = mission.tick().decision.route
    assert np.abs(straight[:, 1]).max() < 3.0 and hidden[:, 1].min() < -0.5


def test_without_a_way_it_says_why_and_ends():
    with Mission(scene([wall(3, 0.0, 0.0, 24.0, yaw=90.0)]), "route", 0, Perception.ORACLE) as mission:
        frame = mission.tick()
    assert frame.status is Status.UNREACHABLE and "building 3" in frame.message


def test_against_a_patrol_it_goes_by_the_clock():
    beat = Patrol(waypoints=(Point(x=9.0, y=-9.0), Point(x=-9.0, y=-9.0)), speed=1.0)
    watched = scene([wall(1, 0.0, 0.0, 9.0)], [eye(1, -9.0, 9.0, patrol=beat, fov_horizontal=120.0)])
    hidden, shortest = driven(watched, "route"), driven(watched, "route_shortest")
    assert hidden.status is Status.REACHED
    assert hidden.summary()["exposed_s"] <= shortest.summary()["exposed_s"] + 0.3


def test_it_must_be_briefed_first():
    with Mission(HIDING, "dwa", 0, Perception.ORACLE) as mission:
        percept = mission.tick().percept
    with pytest.raises(RuntimeError, match="briefed"):
        FollowRoute("route", most_hidden).decide(percept)


def test_it_can_be_pickled_and_goes_on_when_briefed_again():
    with Mission(HIDING, "route", 0, Perception.ORACLE) as mission:
        for _ in range(12):
            frame = mission.tick()
        twin = pickle.loads(pickle.dumps(mission._method))
        twin.brief(HIDING, mission._rays)
        assert twin.decide(frame.percept).waypoint is not None


def test_a_mission_goes_on_from_a_snapshot():
    with Mission(HIDING, "route", 0, Perception.ORACLE) as mission:
        for _ in range(30):
            mission.tick()
        snapshot = mission.snapshot()
    with Mission(HIDING, "route", 0, Perception.ORACLE, snapshot=snapshot) as resumed:
        assert resumed.tick().decision.route is not None and resumed.status is Status.RUNNING


def test_places_along_a_timed_way_are_due_when_they_may_be_left():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    places, due = _evenly(points, 0.5, np.array([0.0, 1.0, 6.0, 7.0]))
    np.testing.assert_allclose(places[:, 0], [0.0, 0.5, 1.0, 1.5, 2.0])
    assert due is not None and due[2] == 6.0 and due[-1] == 7.0 and math.isclose(due[3], 6.5)
