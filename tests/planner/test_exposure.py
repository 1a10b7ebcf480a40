"""Exposure fields: cell by cell what one line of sight says, unknown kept apart, means over beats."""

import numpy as np
import pytest
from lookouts import ground, observer, ridge, stage, thing, view

from planner.exposure import (
    SEEN,
    beat_period,
    common_cycle,
    exposure_field,
    time_averaged,
    views_at,
    viewshed,
)
from scenes.families import generate
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Family, MovingObstacle, Patrol, Point


def plain_exposure(rays, heightmap, view, height=HUSKY.height) -> np.ndarray:
    """Every cell by itself, lines of sight in no common fan."""
    x, y = heightmap.xy()
    points = np.column_stack([x.ravel(), y.ravel(), heightmap.heights.ravel() + height])
    light = rays.visible(np.broadcast_to(view.eye, points.shape), points)
    return np.where(view.holds(points), light, 0.0).reshape(heightmap.shape)


@pytest.mark.parametrize("family", [Family.FOREST, Family.LOW_HIGH])
def test_the_field_is_what_a_line_to_every_cell_says(family):
    scenario = generate(family, 4, size_m=24.0)
    heightmap = scenario.terrain.heightmap()
    rays = RayScene(heightmap, scenario.cover)
    narrow = {"fov_horizontal": 100.0, "range": 15.0, "yaw": 120.0}
    watching = [observer(-8.0, 3.0, id=3), observer(5.0, -9.0, id=8, **narrow)]
    views = views_at(watching, heightmap, 0.0)
    field = exposure_field(rays, heightmap, views)
    assert field.observer_ids == (3, 8)
    for each in views:
        differing = field.of(each.observer_id) != plain_exposure(rays, heightmap, each).astype(np.float32)
        assert differing.mean() < 1e-3  # single-precision lines that graze an edge
    np.testing.assert_array_equal(field.united, field.seen.max(axis=0))
    np.testing.assert_array_equal(field.count, (field.seen >= SEEN).sum(axis=0))


def test_on_bare_ground_it_agrees_with_the_viewshed_of_the_grid():
    heightmap, rays = stage(lambda x, y: 1.2 * np.sin(0.7 * x) * np.cos(0.6 * y))
    row, column = 20, 24
    eye = view(heightmap, *(axis[row, column] for axis in heightmap.xy()), eye_height=0.6)
    field = exposure_field(rays, heightmap, [eye])
    seen = viewshed(heightmap.heights, row, column, 0.6, HUSKY.height)
    assert 0.2 < seen.mean() < 0.95
    assert np.mean((field.united >= SEEN) == seen) > 0.985  # cells are triangles here, lines of samples there


def test_a_coarse_field_is_every_so_manieth_cell_of_the_fine_one():
    heightmap, rays = stage(ridge, [thing("bush", 3.0, 2.0)])
    views = [view(heightmap, 8.0, 0.0)]
    fine, coarse = (exposure_field(rays, heightmap, views, stride=stride) for stride in (1, 3))
    np.testing.assert_array_equal(coarse.united, fine.united[1::3, 1::3])
    assert coarse.resolution == 1.5
    assert (coarse.x_min, coarse.y_min) == (fine.x_min + 0.5, fine.y_min + 0.5)
    with pytest.raises(ValueError, match="stride"):
        exposure_field(rays, heightmap, views, stride=0)


def test_cells_without_data_are_unknown_and_never_hidden_or_seen():
    missing = np.zeros((41, 41), bool)
    missing[:, :10] = True
    heightmap, rays = stage(missing=missing)
    field = exposure_field(rays, heightmap, [view(heightmap, 5.0, 0.0)])
    np.testing.assert_array_equal(field.unknown, missing)
    assert np.isnan(field.united[missing]).all() and (field.united[~missing] == 1.0).all()
    assert (field.count[missing] == -1).all() and (field.count[~missing] == 1).all()
    assert field.share(field.united) == 1.0 and field.mean(field.united) == 1.0
    assert field.area(field.united) == 31 * 41 * 0.25 and field.unknown_area == 10 * 41 * 0.25


def test_without_observers_known_ground_is_hidden_and_the_rest_still_unknown():
    missing = np.zeros((41, 41), bool)
    missing[3, 4] = True
    heightmap, rays = stage(missing=missing)
    for field in (exposure_field(rays, heightmap, ()), time_averaged(rays, heightmap, ())):
        assert np.isnan(field.united[3, 4]) and np.nansum(field.united) == 0.0 and field.count.max() == 0
        assert field.seen.shape == (0, 41, 41)


@pytest.mark.parametrize("nothing", [{"range": 0.0}, {"fov_horizontal": 0.0}, {"fov_vertical": 0.0}])
def test_an_observer_who_cannot_see_exposes_nothing(nothing):
    heightmap, rays = stage()
    assert not exposure_field(rays, heightmap, [view(heightmap, 0.0, 0.0, **nothing)]).united.any()


def test_an_observer_who_is_not_there_is_named():
    heightmap, rays = stage()
    with pytest.raises(KeyError, match="no observer 7"):
        exposure_field(rays, heightmap, [view(heightmap, 0.0, 0.0)]).of(7)


def test_moving_obstacles_hide_where_they_stand():
    heightmap, rays = stage()
    eye = view(heightmap, -8.0, 0.0)
    rays.set_walkers([MovingObstacle(id=1, kind="vehicle", x=0.0, y=0.0, yaw=90.0)])
    field = exposure_field(rays, heightmap, [eye])
    assert field.united[20, 24] == 0.0 and field.united[20, 8] == 1.0
    rays.set_walkers()
    assert exposure_field(rays, heightmap, [eye]).united.min() == 1.0


# --- over time ---------------------------------------------------------------------------------------


def walking(x, y, to, id=1, loop=True, speed=1.0, **fields):
    beat = Patrol(waypoints=tuple(Point(x=px, y=py) for px, py in to), speed=speed, loop=loop)
    return observer(x, y, id=id, patrol=beat, **fields)


def test_the_period_of_a_beat():
    assert beat_period(observer(0.0, 0.0)) == 0.0
    assert beat_period(walking(0, 0, [(3, 0), (3, 4)])) == pytest.approx(12.0)
    assert beat_period(walking(0, 0, [(3, 0), (3, 4)], loop=False, speed=2.0)) == pytest.approx(7.0)
    assert beat_period(walking(1, 1, [(1, 1)])) == 0.0


def test_the_common_cycle_of_several_beats():
    four, six = walking(0, 0, [(2, 0)]), walking(0, 0, [(3, 0)], id=2)
    assert common_cycle([observer(0, 0)]) == 0.0
    assert common_cycle([four]) == 4.0 and common_cycle([four, six]) == 12.0
    incommensurate = walking(0, 0, [(1.123, 0)], id=3)
    assert common_cycle([six, incommensurate]) <= 12 * 6.0


def test_one_who_stands_still_has_the_mean_of_any_moment():
    heightmap, rays = stage(ridge)
    standing = observer(6.0, 0.0)
    mean = time_averaged(rays, heightmap, [standing])
    now = exposure_field(rays, heightmap, views_at([standing], heightmap, 0.0))
    np.testing.assert_array_equal(mean.seen, now.seen)
    np.testing.assert_array_equal(mean.united, now.united)


def test_the_mean_over_a_beat_is_the_mean_of_its_moments():
    heightmap, rays = stage(ridge, [thing("rock", 4.0, 4.0, height=2.0, length=2.0, width=2.0)])
    team = [walking(6.0, -6.0, [(6.0, 6.0)], fov_horizontal=120.0), observer(-7.0, 0.0, id=2, range=6.0)]
    mean = time_averaged(rays, heightmap, team, samples=8)
    times = (np.arange(8) + 0.5) * 24.0 / 8
    moments = [exposure_field(rays, heightmap, views_at(team, heightmap, time_s)) for time_s in times]
    np.testing.assert_allclose(mean.seen, np.mean([now.seen for now in moments], axis=0), atol=1e-6)
    np.testing.assert_allclose(mean.united, np.mean([now.united for now in moments], axis=0), atol=1e-6)
    assert np.any((mean.united > 0.2) & (mean.united < 0.8))
    with pytest.raises(ValueError, match="sample"):
        time_averaged(rays, heightmap, team, samples=0)


def test_the_same_question_has_the_same_answer():
    def field():
        heightmap, rays = stage(ridge, [thing("tree", 2.0, 5.0), thing("bush", -3.0, -3.0, id=2)])
        views = [view(heightmap, 8.0, y, id=index + 1) for index, y in enumerate((-6.0, 0.0, 6.0))]
        return exposure_field(rays, heightmap, views).seen.tobytes()

    assert field() == field()


def test_ground_off_the_middle_of_the_map_is_where_it_says():
    heightmap = ground(cells=9)
    field = exposure_field(RayScene(heightmap), heightmap, [view(heightmap, 0.0, 0.0)], stride=2)
    assert (field.x_min, field.y_min, field.unknown.shape) == (-2.0, -2.0, (5, 5))
