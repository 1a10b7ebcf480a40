"""The truth in the form of a percept's parts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from vlp16 import ground, thing

from planner.elevation_map import MapConfig, window_origin
from planner.oracle import TrueMap, true_cover, true_obstacles
from scenes.catalogue import CoverKind
from scenes.scenario import MovingObstacle, ObstacleKind, Patrol, Point
from scenes.terrain import QUALITIES, SURFACES, Quality, Surface

CONFIG = MapConfig()


def hills(x, y):
    return 1.2 * np.sin(x / 5.0) * np.cos(y / 6.0)


def centres(grid):
    rows, cols = grid.shape
    return np.meshgrid(
        grid.x_min + grid.resolution * np.arange(cols), grid.y_min + grid.resolution * np.arange(rows)
    )


def test_heights_are_the_ground_s_and_unknown_off_the_map():
    heightmap = ground(hills)
    grid = TrueMap(heightmap, (), CONFIG).about(15.0, -3.0)
    x, y = centres(grid)
    on_map = np.abs(x) <= 24.0
    np.testing.assert_allclose(grid.elevation[on_map], heightmap.height_at(x, y)[on_map], atol=1e-6)
    assert np.isnan(grid.elevation[~on_map]).all()
    assert not grid.obstacle.any()
    assert np.all(grid.variance[on_map] == 0.0)
    assert (grid.x_min, grid.y_min) == window_origin(15.0, -3.0, CONFIG)


def test_where_the_survey_has_no_data_nothing_is_known():
    heightmap = ground(hills)
    quality = heightmap.quality.copy()
    quality[100:110, 100:120] = QUALITIES.index(Quality.MISSING)
    grid = TrueMap(replace(heightmap, quality=quality), (), CONFIG).about(0.0, 0.0)
    x, y = centres(grid)
    west, south = heightmap.x_min + 100 * 0.25, heightmap.y_min + 100 * 0.25
    assert grid.unknown[(x > west) & (x < west + 4.7) & (y > south) & (y < south + 2.2)].all()
    assert not grid.unknown[(x < west - 0.3) & (x > -19.0)].any()


@pytest.mark.parametrize("kind", CoverKind)
@pytest.mark.parametrize("yaw", [0.0, 35.0])
def test_footprints_block(kind, yaw):
    cover = thing(kind, 4.3, -2.1, yaw=yaw)
    grid = TrueMap(ground(), [cover], CONFIG).about(0.0, 0.0)
    x, y = centres(grid)
    distance = cover.footprint.distance(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    np.testing.assert_array_equal(grid.obstacle, distance <= 0.5 * CONFIG.resolution)
    assert grid.obstacle.any()


def test_cover_beyond_the_window_is_cut_off():
    house = thing("house", 20.0, 19.0)
    grid = TrueMap(ground(size=80.0), [house, thing("rock", 35.0, 35.0)], CONFIG).about(0.0, 0.0)
    assert grid.obstacle.any()
    assert not grid.obstacle[:150, :].any()


def test_water_and_cliffs_block():
    cliff = ground(lambda x, y: np.where(x > 5.0, 1.0, 0.0))
    surface = cliff.surface.copy()
    surface[:20] = SURFACES.index(Surface.WATER)
    grid = TrueMap(replace(cliff, surface=surface), (), CONFIG).about(0.0, -10.0)
    x, y = centres(grid)
    at_cliff = grid.obstacle & (np.abs(x - 5.0) < 0.5)
    assert np.all(at_cliff.any(axis=1) == ~grid.unknown.all(axis=1))
    assert grid.obstacle[(y < -19.4) & ~grid.unknown].all()


def test_the_window_is_cut_once_and_follows_the_robot():
    truth = TrueMap(ground(hills), (), CONFIG)
    assert truth.about(0.0, 0.0) is truth.about(0.2, -0.2)
    assert truth.about(0.0, 0.0).x_min != truth.about(3.0, 0.0).x_min


def test_moving_obstacles_are_where_they_are_with_their_true_velocity():
    beat = Patrol(waypoints=(Point(x=10.0, y=0.0),), speed=1.5)
    walker = MovingObstacle(id=5, kind=ObstacleKind.PERSON, x=0.0, y=0.0, patrol=beat)
    parked = MovingObstacle(id=2, kind=ObstacleKind.VEHICLE, x=3.0, y=4.0)
    still, walking = true_obstacles([walker, parked], 2.0)
    assert (still.object_id, still.x, still.y, still.vx, still.vy) == (2, 3.0, 4.0, 0.0, 0.0)
    assert (walking.x, walking.vx, walking.vy) == (pytest.approx(3.0), pytest.approx(1.5), pytest.approx(0.0))
    assert walking.radius == 0.25


def test_all_cover_is_known_for_sure():
    bush, house = thing("bush", 3.0, 2.0, id=7), thing("house", -8.0, 1.0, id=3)
    first, second = true_cover([bush, house], ground(hills))
    assert (first.object_id, second.object_id) == (3, 7)
    assert (second.x, second.y, second.confidence) == (3.0, 2.0, 1.0)
    assert second.z == pytest.approx(1.2 * math.sin(0.6) * math.cos(1 / 3), abs=0.02)
    assert (first.width, first.height) == (8.0, 5.5)
