"""Observers that the robot was not told of."""

import math
import pickle

import pytest
from lookouts import observer, ridge, stage, thing

from planner.frames import Perception
from planner.perception import Perceiver
from planner.spotting import SPOTTING_RANGE, Spotter
from scenes.pose import Pose, Twist
from scenes.scenario import GeneratedSource, Patrol, Point, Scenario, Start, Terrain

HERE = Pose(-5.0, 0.0, 0.0)


def spotted(*observers, cover=(), heights=None, pose=HERE, time_s=0.0, spotter=None):
    heightmap, rays = stage(heights, cover)
    spotter = spotter or Spotter()
    spotter.look(rays, heightmap, pose, observers, time_s)
    return spotter.known(observers)


def test_who_is_known_needs_no_spotting():
    told = observer(9.0, 9.0)
    assert spotted(told, heights=ridge) == (told,)


def test_a_stranger_in_the_open_is_spotted():
    (seen,) = spotted(observer(5.0, 0.0, known=False, yaw=30.0))
    assert (seen.x, seen.y, seen.id) == (5.0, 0.0, 1) and not seen.known


def test_a_stranger_behind_a_wall_is_not():
    wall = thing("building", 1.0, 0.0, length=4.0, width=14.0, height=4.0)
    assert spotted(observer(5.0, 0.0, known=False), cover=[wall]) == ()


def test_a_head_over_the_crest_is_enough():
    assert spotted(observer(5.0, 0.0, known=False, eye_height=1.0), heights=ridge) == ()
    assert len(spotted(observer(5.0, 0.0, known=False, eye_height=6.0), heights=ridge)) == 1


def test_beyond_the_detection_range_nobody_is_spotted():
    stranger = observer(9.0, 0.0, known=False)
    assert SPOTTING_RANGE == 25.0 and len(spotted(stranger)) == 1
    assert spotted(stranger, spotter=Spotter(reach=13.0)) == ()


def test_a_patrol_that_goes_out_of_sight_is_where_it_was_last_seen():
    wall = thing("building", 2.0, 6.0, length=2.0, width=8.0, height=4.0)
    beat = Patrol(waypoints=(Point(x=7.0, y=8.0),), speed=1.0)
    stranger = observer(7.0, 0.0, known=False, patrol=beat)
    heightmap, rays = stage(cover=[wall])
    spotter = Spotter()
    spotter.look(rays, heightmap, HERE, [stranger], 1.0)
    (seen,) = spotter.known([stranger])
    assert (seen.x, seen.y, seen.yaw, seen.patrol) == pytest.approx((7.0, 1.0, 90.0, None))
    spotter.look(rays, heightmap, HERE, [stranger], 6.0)
    assert spotter.known([stranger]) == (seen,)
    spotter.look(rays, heightmap, HERE, [stranger], 15.0)
    assert spotter.known([stranger])[0].y == pytest.approx(1.0) and spotter.known([stranger])[0].yaw == -90.0


def test_who_is_taken_out_of_the_scene_is_forgotten():
    stranger, other = observer(5.0, 0.0, known=False), observer(0.0, 5.0, id=2, known=False)
    heightmap, rays = stage()
    spotter = Spotter()
    spotter.look(rays, heightmap, HERE, [stranger, other], 0.0)
    spotter.look(rays, heightmap, HERE, [other], 0.1)
    assert [each.id for each in spotter.known([stranger, other])] == [2]


@pytest.mark.parametrize("perception", list(Perception))
def test_the_percept_has_those_that_were_spotted(perception):
    heightmap, rays = stage(cover=[thing("building", 4.0, 0.0, length=4.0, width=5.0, height=4.0)])
    hidden, open_, told = (
        observer(8.0, 0.0, id=3, known=False),
        observer(-5.0, 6.0, id=4, known=False),
        observer(8.0, 8.0, id=5),
    )
    scenario = Scenario(
        version=1, name="lookout",
        terrain=Terrain(
            resolution=heightmap.resolution, heights=heightmap.heights,
            surface=heightmap.surface_symbols(), source=GeneratedSource(family="normal", seed=0),
        ),
        start=Start(x=-5.0, y=0.0), goal=Point(x=-2.0, y=0.0), observers=(hidden, open_, told),
    )  # fmt: skip
    perceiver = Perceiver(scenario, perception)
    percept = perceiver.perceive(rays, HERE, Twist(), 0.0, (-2.0, 0.0))
    assert percept.known_observers == (4, 5) == tuple(each.id for each in percept.observers)
    assert percept.observer_eyes[0] == pytest.approx((-5.0, 6.0, 1.7))
    again = pickle.loads(pickle.dumps(perceiver))
    behind = Pose(9.0, -8.0, 0.0, yaw=math.pi)
    assert again.perceive(rays, behind, Twist(), 0.1, (-2.0, 0.0)).known_observers == (3, 4, 5)
