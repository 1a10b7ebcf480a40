"""Views: what lies in range and field of view, where patrols look, and how much of the robot is seen."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lookouts import ground, observer, ridge, stage, thing, view

from planner.line_of_sight import View, views_at, visible_fraction
from scenes.pose import Pose, wrap_angle
from scenes.robot import HUSKY
from scenes.scenario import Patrol, Point

FLAT = ground()
HERE = Pose(0.0, 0.0, 0.0)

angle = st.floats(-math.pi, math.pi)


def plainly_held(view: View, point: np.ndarray) -> bool:
    """The definition by angles, point by point."""
    if view.range <= 0.0 or view.fov_horizontal <= 0.0 or view.fov_vertical <= 0.0:
        return False
    offset = point - view.eye
    level = math.hypot(offset[0], offset[1])
    aside = abs(wrap_angle(math.atan2(offset[1], offset[0]) - view.yaw)) if level > 0.0 else 0.0
    rise = math.atan2(abs(offset[2]), level)
    return (
        math.hypot(level, offset[2]) <= view.range
        and aside <= 0.5 * view.fov_horizontal
        and rise <= 0.5 * view.fov_vertical
    )


@given(
    st.floats(0.0, 2.0 * math.pi), st.floats(0.0, math.pi), st.floats(0.0, 30.0), angle,
    st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_a_view_holds_what_range_and_angles_say(horizontal, vertical, reach, yaw, seed):
    looking = View(1, 1.0, -2.0, 3.0, yaw, horizontal, vertical, reach)
    points = np.random.default_rng(seed).uniform(-20.0, 20.0, (50, 3))
    assert looking.holds(points).tolist() == [plainly_held(looking, point) for point in points]


@pytest.mark.parametrize("nothing", [{"range": 0.0}, {"fov_horizontal": 0.0}, {"fov_vertical": 0.0}])
def test_no_range_or_no_field_of_view_sees_nothing(nothing):
    looking = view(FLAT, 0.0, 0.0, **nothing)
    assert looking.blind and not looking.holds(np.array([looking.eye, [1.0, 0.0, 1.7]])).any()


@given(angle, angle)
def test_all_round_has_no_seam(yaw, bearing):
    looking = View(1, 0.0, 0.0, 0.0, yaw, 2.0 * math.pi, math.pi, 10.0)
    assert looking.holds(np.array([[math.cos(bearing), math.sin(bearing), 0.3], [0.0, 0.0, -9.0]])).all()


def test_the_eye_is_above_the_ground_that_the_observer_stands_on():
    hill = ground(ridge)
    assert view(hill, 0.0, 3.0, eye_height=1.5).z == pytest.approx(3.5)
    assert view(hill, 0.0, 3.0, eye_height=0.0).z == pytest.approx(2.0)


def test_a_patrol_moves_and_looks_along_its_way():
    beat = Patrol(waypoints=(Point(x=4.0, y=0.0), Point(x=4.0, y=4.0)), speed=2.0)
    walker = observer(0.0, 0.0, yaw=-90.0, patrol=beat)
    first, later = (views_at([walker], FLAT, time_s)[0] for time_s in (1.0, 3.0))
    assert (first.x, first.y, first.yaw) == pytest.approx((2.0, 0.0, 0.0))
    assert (later.x, later.y, later.yaw) == pytest.approx((4.0, 2.0, math.pi / 2))


def test_a_patrol_of_one_point_that_it_stands_on_looks_where_it_faces():
    standing = observer(1.0, 1.0, yaw=90.0, patrol=Patrol(waypoints=(Point(x=1.0, y=1.0),)))
    looking = views_at([standing], FLAT, 7.0)[0]
    assert (looking.x, looking.y, looking.yaw) == pytest.approx((1.0, 1.0, math.pi / 2))


def test_in_the_open_all_of_the_robot_is_seen():
    heightmap, rays = stage()
    seen = visible_fraction(rays, [view(heightmap, 6.0, 0.0)], HERE)
    assert seen.united == 1.0 and seen.each.tolist() == [1.0]


def test_behind_a_ridge_nothing_is_seen():
    heightmap, rays = stage(ridge)
    pose = Pose(-4.0, 0.0, float(heightmap.height_at(-4.0, 0.0)))
    assert visible_fraction(rays, [view(heightmap, 6.0, 0.0, eye_height=1.0)], pose).united == 0.0


def test_a_bush_leaves_a_fifth():
    heightmap, rays = stage(cover=[thing("bush", 3.0, 0.0, height=3.0, length=6.0, width=6.0)])
    seen = visible_fraction(rays, [view(heightmap, 9.0, 0.0)], HERE)
    assert seen.united == pytest.approx(0.2, abs=1e-6)


def test_united_takes_for_each_point_who_sees_it_best():
    """A wall hides one half of the robot from the left, the other half from the right."""
    heightmap, rays = stage(cover=[thing("rock", 0.0, -2.5, length=0.4, width=3.0, height=3.0)])
    left = view(heightmap, -1.2, -6.0, id=1)
    right = view(heightmap, 1.2, -6.0, id=2)
    pose = Pose(0.0, 1.0, 0.0)
    seen = visible_fraction(rays, [left, right], pose)
    one, other = (visible_fraction(rays, [each], pose).united for each in (left, right))
    assert seen.each == pytest.approx([one, other]) and max(one, other) < seen.united <= one + other


def test_the_field_of_view_cuts_the_robot():
    heightmap, rays = stage()
    looking = view(heightmap, 0.0, -3.0, yaw=90.0, fov_horizontal=10.0)
    fraction = visible_fraction(rays, [looking], HERE).united
    held = looking.holds(HUSKY.hull_points())
    assert 0.0 < fraction < 1.0 and fraction == pytest.approx(held.mean())


def test_an_eye_inside_a_solid_thing_sees_nothing_outside():
    heightmap, rays = stage(cover=[thing("building", 6.0, 0.0, length=6.0, width=6.0, height=5.0)])
    assert visible_fraction(rays, [view(heightmap, 6.0, 0.0)], HERE).united == 0.0


def test_an_observer_on_the_maps_edge_sees_in():
    heightmap, rays = stage()
    west, east, south, north = heightmap.bounds
    for x, y in ((west, 0.0), (east, north), (0.0, south)):
        assert visible_fraction(rays, [view(heightmap, x, y)], HERE).united == 1.0


def test_nobody_sees_nothing():
    _, rays = stage()
    seen = visible_fraction(rays, (), HERE)
    assert seen.united == 0.0 and seen.each.shape == (0,)


def test_two_hundred_observers_are_each_answered():
    heightmap, rays = stage(ridge)
    crowd = [observer(9.0 * math.cos(k), 9.0 * math.sin(k), id=k + 1, eye_height=1.0) for k in range(200)]
    pose = Pose(4.0, 0.0, float(heightmap.height_at(4.0, 0.0)))
    views = views_at(crowd, heightmap, 0.0)
    seen = visible_fraction(rays, views, pose)
    assert seen.each.shape == (200,) and seen.united >= seen.each.max()
    for index in (0, 77, 199):
        assert seen.each[index] == visible_fraction(rays, [views[index]], pose).united
