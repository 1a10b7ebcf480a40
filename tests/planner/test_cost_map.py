"""The cost map: slope, roughness, obstacles and unknown ground, and where the robot must not go."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maps import grid_map

from planner.cost_map import CostConfig, build, ground_near, obstacle_distance, surface_shape

CONFIG = CostConfig()


def ramp(degrees):
    return grid_map(lambda x, y: math.tan(math.radians(degrees)) * x)


def test_flat_free_known_ground_costs_nothing():
    cost = build(grid_map(), CONFIG)
    assert (cost.total == 0.0).all()
    assert set(cost.layers) == {"slope", "roughness", "obstacle", "unknown"}


@pytest.mark.parametrize("degrees", [5, 12, 20])
def test_slope_costs_more_the_steeper_it_is(degrees):
    middle = build(ramp(degrees), CONFIG).layers["slope"][40, 40]
    expected = CONFIG.slope * (math.tan(math.radians(degrees)) / math.tan(CONFIG.max_slope)) ** 2
    assert middle == pytest.approx(expected, rel=1e-3)


def test_ground_steeper_than_the_robot_climbs_is_forbidden():
    assert build(ramp(24), CONFIG).forbidden[1:-1, 1:-1].all()
    assert not build(ramp(21), CONFIG).forbidden.any()


def test_obstacles_forbid_a_rim_and_cost_less_with_distance():
    cost = build(grid_map(blocked=lambda x, y: np.hypot(x, y) < 0.1), CONFIG)
    row, col = cost.cell(0.0, 0.0)
    rim = int(CONFIG.rim / 0.2)
    along = cost.total[row, col:]
    assert np.isinf(along[: rim + 1]).all()
    beyond = along[rim + 1 :]
    assert np.isfinite(beyond).all() and (np.diff(beyond) <= 0).all()
    assert beyond[-1] == 0.0


def test_where_only_the_margin_is_missing_is_tight():
    cost = build(grid_map(blocked=lambda x, y: np.abs(x) < 0.1), CONFIG)
    tight = cost.tight[cost.cell(0.0, 0.0)[0]]
    at = {round(0.2 * step, 1): tight[cost.cell(0.2 * step, 0.0)[1]] for step in range(4)}
    assert at == {0.0: False, 0.2: False, 0.4: True, 0.6: False}
    assert cost.forbidden[cost.tight].all()


def test_what_stands_on_the_ground_does_not_make_it_steep():
    box = grid_map(lambda x, y: 1.0 * (np.abs(x) < 0.1), lambda x, y: np.abs(x) < 0.1)
    assert not ground_near(box, 0.0, 0.0, 2.0, CONFIG).forbidden.any()
    bank = grid_map(lambda x, y: 1.0 * (np.abs(x) < 0.1))
    assert ground_near(bank, 0.0, 0.0, 2.0, CONFIG).forbidden.any()


def test_rough_ground_costs_and_a_plane_does_not():
    rng = np.random.default_rng(3)
    bumps = rng.normal(0.0, 0.03, (81, 81))
    assert build(grid_map(lambda x, y: bumps), CONFIG).layers["roughness"].mean() > 1.0
    inner = build(ramp(15), CONFIG).layers["roughness"][1:-1, 1:-1]
    assert inner.max() == pytest.approx(0.0, abs=1e-3)


def test_unknown_ground_costs_little_and_is_drawn_as_unknown():
    cost = build(grid_map(unknown=lambda x, y: x > 3.0), CONFIG)
    row, col = cost.cell(5.0, 0.0)
    assert cost.total[row, col] == CONFIG.unknown
    assert np.isnan(cost.patch().cost[row, col])


def test_the_total_stays_within_a_hundred():
    everything = grid_map(
        lambda x, y: 0.35 * x + 0.2 * np.sin(9.0 * x) * np.sin(7.0 * y),
        lambda x, y: (np.abs(x) < 0.1) & (y > 0),
    )
    total = build(everything, CONFIG).total
    finite = np.isfinite(total)
    assert total[finite].min() >= 0.0 and total[finite].max() <= 100.0


def test_without_obstacles_the_nearest_is_infinitely_far():
    assert np.isinf(obstacle_distance(grid_map())).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.2, 0.5, 1.3]))
def test_near_obstacles_are_as_far_as_by_the_whole_transform(seed, reach):
    rng = np.random.default_rng(seed)
    grid = grid_map(blocked=lambda x, y: rng.random(x.shape) < rng.choice([0.001, 0.02, 0.3]))
    far = obstacle_distance(grid)
    np.testing.assert_array_equal(obstacle_distance(grid, reach), np.where(far <= reach, far, np.inf))


def test_cells_and_centres_agree():
    cost = build(grid_map(), CONFIG)
    np.testing.assert_allclose(cost.centre(*cost.cell(1.41, -2.19)), (1.4, -2.2), atol=1e-9)


def plain_surface_shape(elevation, resolution):
    """Plane fit and its residual, cell by cell, by means of a matrix of the neighbourhood."""
    rows, cols = elevation.shape
    padded = np.pad(elevation, 1, constant_values=np.nan)
    gradient, roughness = np.full((rows, cols), np.nan), np.full((rows, cols), np.nan)
    step = np.array([-1.0, 0.0, 1.0])
    for row in range(rows):
        for col in range(cols):
            window = padded[row : row + 3, col : col + 3]
            known = ~np.isnan(window)
            if known.sum() < 6 or not known[1, 1]:
                continue
            offset = np.where(known, window - window[known].mean(), 0.0)
            slopes = np.array([(offset * step).sum(), (offset * step[:, None]).sum()]) / 6.0
            gradient[row, col] = np.hypot(*slopes) / resolution
            stray = (offset**2).sum() - 6.0 * (slopes**2).sum()
            roughness[row, col] = np.sqrt(max(stray, 0.0) / known.sum())
    return gradient, roughness


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_surface_shape_agrees_with_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    elevation = rng.normal(0.0, 0.1, rng.integers(1, 14, 2))
    elevation[rng.random(elevation.shape) < rng.choice([0.0, 0.2, 0.6])] = np.nan
    for ours, plain in zip(surface_shape(elevation, 0.2), plain_surface_shape(elevation, 0.2), strict=True):
        np.testing.assert_allclose(ours, plain, atol=1e-7)


@pytest.mark.parametrize("place", [(0.0, 0.0), (7.9, -7.9), (30.0, 0.0)])
def test_ground_near_is_the_map_about_the_robot(place):
    grid = grid_map(lambda x, y: 0.1 * x + 0.02 * y)
    ground = ground_near(grid, *place, 2.0, CONFIG)
    assert ground.elevation.shape == ground.forbidden.shape
    rows, cols = ground.elevation.shape
    assert rows <= 21 and cols <= 21
    for row, col in ((0, 0), (rows - 1, cols - 1)):
        if rows and cols:
            x, y = ground.x_min + 0.2 * col, ground.y_min + 0.2 * row
            assert ground.elevation[row, col] == pytest.approx(0.1 * x + 0.02 * y, abs=1e-6)
