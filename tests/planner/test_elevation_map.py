"""The rolling map: what it knows, what blocks, what fades, what is kept and what is forgotten."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vlp16 import ground, standing, thing, turn

from planner.elevation_kernels import WEIGHT, turned_patch
from planner.elevation_map import ElevationMap, MapConfig, elevation_patch, step_cells, window_origin
from planner.frames import GridMap
from scenes.pose import Pose
from scenes.rays import RayScene

SLOPE = math.tan(math.radians(20.0))


def drive(heightmap, cover=(), start=-2.0, ticks=8, sigma=0.01, step=0.2):
    """A map after driving along x with a scan every 0.2 m."""
    rays, elevation_map = RayScene(heightmap, cover), ElevationMap(start, 0.0)
    for tick in range(ticks):
        pose = standing(heightmap, start + step * tick, 0.0)
        elevation_map.move_to(pose.x, pose.y)
        elevation_map.stand_at(pose)
        elevation_map.add_scan(turn(rays, pose, sigma, seed=tick)[0], pose)
    return elevation_map, pose


def centres(grid: GridMap):
    rows, cols = grid.shape
    return np.meshgrid(
        grid.x_min + grid.resolution * np.arange(cols), grid.y_min + grid.resolution * np.arange(rows)
    )


def footprint_distance(grid: GridMap, cover):
    x, y = centres(grid)
    return cover.footprint.distance(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)


GROUNDS = {
    "flat": lambda x, y: 0.0 * x,
    "uphill": lambda x, y: SLOPE * x,
    "along the slope": lambda x, y: SLOPE * y,
    "hills": lambda x, y: 1.2 * np.sin(x / 5.0) * np.cos(y / 6.0),
    "rough grass": lambda x, y: np.random.default_rng(3).uniform(-0.03, 0.03, x.shape),
}


@pytest.mark.parametrize("sigma", [0.008, 0.03])
@pytest.mark.parametrize("name", GROUNDS)
def test_drivable_ground_is_mapped_and_nothing_blocks_there(name, sigma):
    heightmap = ground(GROUNDS[name])
    grid = drive(heightmap, sigma=sigma)[0].grid()
    error = (grid.elevation - heightmap.height_at(*centres(grid)))[~grid.unknown]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.abs(error).max() < 0.15
    assert not grid.obstacle.any()
    assert (~grid.unknown).sum() > 5000


@pytest.mark.parametrize("name", ["flat", "uphill", "along the slope"])
@pytest.mark.parametrize(
    "kind", ["tree", "bush", "rock", "cottage", "building", "house", "disabled_vehicle", "fence"]
)
def test_what_stands_in_the_way_blocks_and_only_there(kind, name):
    heightmap, cover = ground(GROUNDS[name]), thing(kind, 6.0, 1.0, yaw=90.0)
    grid = drive(heightmap, [cover])[0].grid()
    distance = footprint_distance(grid, cover)
    assert np.any(grid.obstacle & (distance < 0.15))
    assert not np.any(grid.obstacle & (distance > 0.45))


def test_a_crown_hangs_over_the_ground_and_does_not_block():
    tree = thing("tree", 5.0, 0.0, length=4.0)
    grid = drive(ground(), [tree])[0].grid()
    x, y = centres(grid)
    under_crown = np.hypot(x - 5.0, y) < 1.6
    assert np.any(np.isfinite(grid.overhang) & under_crown)
    assert np.all(grid.overhang[under_crown & ~grid.obstacle] >= np.float32(MapConfig().clearance))
    assert np.all(np.hypot(x - 5.0, y)[grid.obstacle] < 0.6)
    assert np.abs(grid.elevation[under_crown & ~grid.unknown & ~grid.obstacle]).max() < 0.1


def test_the_ring_about_the_robot_is_unknown_and_the_ground_under_it_known():
    grid = drive(ground(), start=0.0, ticks=1)[0].grid()
    x, y = centres(grid)
    assert not grid.unknown[(np.abs(x) < 0.4) & (np.abs(y) < 0.3)].any()
    ring = (np.hypot(x, y) > 0.8) & (np.hypot(x, y) < 2.5)
    assert grid.unknown[ring].all()
    assert np.all(np.isnan(grid.variance) == grid.unknown)


def test_a_robot_that_has_tipped_over_says_nothing_of_the_ground_under_it():
    elevation_map = ElevationMap(0.0, 0.0)
    elevation_map.stand_at(Pose(0.0, 0.0, 0.0, roll=1.6))
    assert elevation_map.grid().unknown.all()


def test_what_has_gone_fades_within_a_second_of_looks_through_it():
    heightmap = ground()
    pose, rock = standing(heightmap, 0.0, 0.0), thing("rock", 4.0, 0.0)
    elevation_map = ElevationMap(0.0, 0.0)
    with_rock, without = RayScene(heightmap, [rock]), RayScene(heightmap)
    for seed in range(10):
        elevation_map.add_scan(turn(with_rock, pose, 0.01, seed)[0], pose)
    assert elevation_map.grid().obstacle.any()
    for seed in range(10):
        elevation_map.add_scan(turn(without, pose, 0.01, seed)[0], pose)
    assert not elevation_map.grid().obstacle.any()


@pytest.mark.parametrize("kind", ["rock", "bush", "tree", "fence"])
def test_what_stays_does_not_flicker(kind):
    heightmap = ground()
    rays, pose = RayScene(heightmap, [thing(kind, 4.0, 0.5)]), standing(heightmap, 0.0, 0.0)
    elevation_map, seen = ElevationMap(0.0, 0.0), []
    for seed in range(15):
        elevation_map.add_scan(turn(rays, pose, 0.02, seed)[0], pose)
        seen.append(elevation_map.grid().obstacle)
    always = np.all(seen[5:], axis=0)
    assert always.sum() >= 0.8 * np.any(seen[5:], axis=0).sum() > 0


def test_what_is_too_near_for_the_beams_is_remembered():
    """The lowest beam passes over a low rock that the robot has come close to."""
    rock = thing("rock", 0.0, 1.2, height=0.4, length=0.8, width=0.8)
    elevation_map, pose = drive(ground(), [rock], start=-4.0, ticks=21)
    assert abs(pose.x) < 0.1
    assert np.any(elevation_map.grid().obstacle & (footprint_distance(elevation_map.grid(), rock) < 0.1))


@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_rolling_moves_cells_and_changes_none(x, y):
    config = MapConfig(size=8.0, resolution=0.25)
    elevation_map = ElevationMap(0.0, 0.0, config)
    elevation_map._cells = np.random.default_rng(0).random(elevation_map._cells.shape)
    before, x_min, y_min = elevation_map._cells, elevation_map.x_min, elevation_map.y_min
    elevation_map.move_to(x, y)
    rows, cols = np.indices(before.shape[1:])
    from_row = rows + round((elevation_map.y_min - y_min) / 0.25)
    from_col = cols + round((elevation_map.x_min - x_min) / 0.25)
    kept = (from_row >= 0) & (from_row < config.cells) & (from_col >= 0) & (from_col < config.cells)
    np.testing.assert_array_equal(elevation_map._cells[:, kept], before[:, from_row[kept], from_col[kept]])
    assert np.all(elevation_map._cells[WEIGHT, ~kept] == 0.0)
    middle = elevation_map.x_min + 0.5 * (config.cells - 1) * 0.25
    assert abs(middle - x) <= 0.5 + 1e-9


def test_what_leaves_the_window_is_forgotten():
    elevation_map, _ = drive(ground())
    elevation_map.move_to(100.0, 0.0)
    elevation_map.move_to(0.0, 0.0)
    assert elevation_map.grid().unknown.all()


def test_extremes_hold_every_return_from_the_ground():
    elevation_map, _ = drive(ground(GROUNDS["rough grass"]))
    lowest, highest = elevation_map.extremes
    mean = elevation_map.grid().elevation
    known = np.isfinite(lowest)
    assert known.sum() > 1000
    assert np.all((lowest[known] <= mean[known] + 1e-6) & (mean[known] <= highest[known] + 1e-6))


def test_variance_is_larger_where_a_gap_was_filled():
    elevation_map, _ = drive(ground())
    grid = elevation_map.grid()
    measured = np.isfinite(elevation_map.extremes[0])
    filled = ~grid.unknown & ~measured
    assert filled.any()
    assert np.median(grid.variance[filled]) > 4.0 * np.median(grid.variance[measured])


def test_a_step_higher_than_the_wheels_climb_is_marked_on_its_upper_side():
    config = MapConfig()
    elevation = np.zeros((5, 6))
    elevation[:, 3:] = 0.4
    assert np.array_equal(np.unique(np.nonzero(step_cells(elevation, config))[1]), [3, 4])
    assert not step_cells(np.where(elevation > 0, 0.14, 0.0), config).any()


def test_a_steep_but_drivable_slope_is_no_step():
    config = MapConfig()
    x = np.arange(20) * config.resolution
    assert not step_cells(np.tile(math.tan(math.radians(22.0)) * x, (20, 1)), config).any()


def plane(pose: Pose, unknown=lambda x, y: np.zeros(x.shape, bool)) -> GridMap:
    """A grid about the pose whose elevation is 0.1 x + 0.2 y."""
    config = MapConfig()
    x_min, y_min = window_origin(pose.x, pose.y, config)
    empty = np.zeros((config.cells, config.cells), np.float32)
    grid = GridMap(x_min, y_min, config.resolution, empty, empty, empty > 0, empty, empty)
    x, y = centres(grid)
    elevation = np.where(unknown(x, y), np.nan, 0.1 * x + 0.2 * y).astype(np.float32)
    return GridMap(x_min, y_min, config.resolution, elevation, empty, empty > 0, empty, empty)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-math.pi, math.pi))
def test_the_patch_is_the_ground_ahead_and_to_the_left_relative_to_the_robot(x, y, yaw):
    pose = Pose(x, y, 0.1 * x + 0.2 * y, yaw=yaw)
    patch, unknown = elevation_patch(plane(pose), pose)
    assert patch.shape == unknown.shape == (40, 40)
    assert not unknown.any()
    along = (np.arange(40) - 19.5) * 0.5
    forward, left = np.meshgrid(along, along)
    ahead, aside = 0.1 * math.cos(yaw) + 0.2 * math.sin(yaw), -0.1 * math.sin(yaw) + 0.2 * math.cos(yaw)
    np.testing.assert_allclose(patch, ahead * forward + aside * left, atol=0.04)


@pytest.mark.parametrize("seed", range(4))
def test_the_turned_patch_agrees_with_its_plain_twin(seed):
    draw = np.random.default_rng(seed)
    elevation = draw.normal(size=(30, 50)).astype(np.float32)
    elevation[draw.random(elevation.shape) < 0.2] = np.nan
    x_min, y_min, (x, y), yaw = -5.0, -3.0, draw.uniform(-6.0, 6.0, 2), draw.uniform(-4.0, 4.0)
    along = (np.arange(12) - 5.5) * 0.5
    forward, left = np.meshgrid(along, along)
    col = np.rint((x + np.cos(yaw) * forward - np.sin(yaw) * left - x_min) / 0.2).astype(int)
    row = np.rint((y + np.sin(yaw) * forward + np.cos(yaw) * left - y_min) / 0.2).astype(int)
    on_map = (row >= 0) & (row < 30) & (col >= 0) & (col < 50)
    plain = np.where(on_map, elevation[row.clip(0, 29), col.clip(0, 49)], np.nan)
    ours = turned_patch(elevation, x_min, y_min, 0.2, x, y, yaw, 12, 0.5)
    np.testing.assert_array_equal(ours, plain)


def test_unknown_cells_of_the_patch_take_the_nearest_known_height():
    pose = Pose(0.0, 0.0, 0.0)
    patch, unknown = elevation_patch(plane(pose, unknown=lambda x, y: x > 2.0), pose)
    np.testing.assert_array_equal(unknown, np.tile((np.arange(40) - 19.5) * 0.5 > 2.0, (40, 1)))
    np.testing.assert_array_equal(patch[unknown], np.repeat(patch[:, 23], unknown[0].sum()))


def test_a_patch_of_nothing_known_is_level():
    patch, unknown = elevation_patch(plane(Pose(0.0, 0.0, 0.0), lambda x, y: x == x), Pose(0.0, 0.0, 5.0))
    assert unknown.all()
    assert not patch.any()


def test_the_map_s_own_patch_is_that_of_its_grid():
    elevation_map, pose = drive(ground(GROUNDS["hills"]), ticks=3)
    for ours, cut in zip(elevation_map.patch(pose), elevation_patch(elevation_map.grid(), pose), strict=True):
        np.testing.assert_array_equal(ours, cut)


def test_the_same_scans_make_the_same_map():
    one, other = (drive(ground(GROUNDS["hills"]), [thing("bush", 5.0, 1.0)])[0].grid() for _ in range(2))
    for name in ("elevation", "variance", "obstacle", "overhang"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
