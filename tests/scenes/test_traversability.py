"""Where the Husky can go on the true map."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small import flat, with_water

from scenes.robot import HUSKY
from scenes.scenario import CoverSpec
from scenes.terrain import QUALITY_CODE, Heightmap, Quality
from scenes.traversability import blocked_cells, reachable


def shaped(heights, resolution: float = 0.25) -> Heightmap:
    blank = np.zeros(heights.shape, np.uint8)
    return Heightmap(heights, resolution, blank, blank)


def inclined(degrees: float, resolution: float) -> Heightmap:
    x = resolution * np.arange(41)
    return shaped(np.tile(math.tan(math.radians(degrees)) * x, (41, 1)), resolution)


def wall(x: float, length: float, gap_at: float | None = None) -> tuple[CoverSpec, ...]:
    """A fence along y at `x`, from the south edge on, perhaps with an opening of 1.5 m."""
    if gap_at is None:
        return (CoverSpec(kind="fence", x=x, y=0.0, yaw=90.0, length=length),)
    south, north = gap_at - 0.75 + 10.0, 10.0 - gap_at - 0.75
    return (
        CoverSpec(kind="fence", x=x, y=-10.0 + 0.5 * south, yaw=90.0, length=south),
        CoverSpec(kind="fence", x=x, y=10.0 - 0.5 * north, yaw=90.0, length=north),
    )


@pytest.mark.parametrize("resolution", [0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize(("degrees", "blocked"), [(0.0, False), (20.0, False), (24.0, True), (40.0, True)])
def test_slopes_block_beyond_the_husky_s_limit(degrees, resolution, blocked):
    middle = blocked_cells(inclined(degrees, resolution), clearance=0.0)[10:-10, 10:-10]
    assert (middle == blocked).all()


@pytest.mark.parametrize(("height", "blocked"), [(0.08, False), (0.2, True)])
def test_a_step_blocks_when_it_is_higher_than_the_husky_climbs(height, blocked):
    heights = np.zeros((41, 41))
    heights[:, 20:] = height
    assert blocked_cells(shaped(heights), clearance=0.0)[:, 20].all() == blocked


def test_bumps_below_the_scale_of_the_robot_are_no_slopes():
    heights = 0.02 * np.random.default_rng(1).random((101, 101))
    assert not blocked_cells(shaped(heights, 0.1), clearance=0.0)[5:-5, 5:-5].any()


def test_water_and_missing_data_block_with_clearance():
    ground = with_water(flat(41, 0.5), slice(20, 21), slice(20, 21))
    ground.quality[30, 30] = QUALITY_CODE[Quality.MISSING]
    blocked = blocked_cells(ground, clearance=0.6)
    assert blocked[20, 21] and blocked[30, 29] and not blocked[20, 22] and not blocked[25, 25]


def test_the_edge_of_the_map_blocks_with_clearance():
    blocked = blocked_cells(flat(41, 0.5), clearance=0.6)
    assert blocked[1].all() and blocked[:, -2].all() and not blocked[2:-2, 2:-2].any()


@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-180.0, 180.0), st.floats(0.0, 1.0))
@settings(max_examples=30)
def test_cover_blocks_the_cells_nearer_than_the_clearance(x, y, yaw, clearance):
    ground = flat(41, 0.5)
    thing = CoverSpec(kind="disabled_vehicle", x=x, y=y, yaw=yaw)
    points = np.column_stack([axis.ravel() for axis in ground.xy()])
    near = (thing.footprint.distance(points) < clearance).reshape(ground.shape)
    edge = blocked_cells(ground, clearance=clearance)
    assert (blocked_cells(ground, [thing], clearance) == (near | edge)).all()


def test_a_trunk_blocks_and_its_crown_does_not():
    blocked = blocked_cells(flat(81, 0.25), [CoverSpec(kind="tree", x=0.0, y=0.0)], HUSKY.inscribed_radius)
    assert blocked[40, 40] and blocked[40, 42] and not blocked[40, 43]


@pytest.mark.parametrize(
    ("cover", "passes"), [((), True), (wall(0.0, 20.0), False), (wall(0.0, 20.0, gap_at=4.0), True)]
)
def test_a_goal_behind_a_fence_is_reachable_through_an_opening_alone(cover, passes):
    assert reachable(flat(81, 0.25), cover, (-6.0, 0.0), (6.0, 0.0)) is passes


def test_an_opening_must_be_wide_enough():
    cover = wall(0.0, 20.0, gap_at=4.0)
    assert not reachable(flat(81, 0.25), cover, (-6.0, 0.0), (6.0, 0.0), clearance=0.9)


def test_no_way_begins_or_ends_in_an_obstacle():
    house = CoverSpec(kind="house", x=6.0, y=0.0)
    assert not reachable(flat(81, 0.25), [house], (-6.0, 0.0), (6.0, 0.0))
    assert not reachable(flat(81, 0.25), [house], (6.0, 0.0), (6.0, 0.0))


def test_diagonal_cracks_are_no_way():
    heights = np.zeros((41, 41))
    heights[np.arange(41), np.arange(41)] = 1.0
    assert not reachable(shaped(heights), (), (-3.0, 3.0), (3.0, -3.0), clearance=0.0)
