"""Where an observer not yet seen may stand, by the robot's own map."""

from dataclasses import replace

import numpy as np
import pytest
from maps import grid_map, percept

from planner.belief import BeliefConfig
from planner.map_sight import MapSight
from planner.sensed_belief import SensedBelief
from scenes.pose import Pose

ROUTE = ((-3.0, -3.0), (-3.0, 3.0))
HERE = Pose(-3.0, 0.0, 0.0)
FEW = BeliefConfig(places=120, drawn=24, range=16.0)


def ridge(x, y):
    """A wall of earth along y at x = 0, 2 m high."""
    return 2.0 * np.exp(-(x**2))


def belief(seed=0) -> SensedBelief:
    return SensedBelief(ROUTE, np.random.default_rng(seed), FEW)


def seen(grid=None) -> tuple:
    about = percept(grid_map(ridge) if grid is None else grid, HERE)
    return about, MapSight.of(about)


def looked(grid=None) -> tuple[SensedBelief, MapSight]:
    guess, (about, on_map) = belief(), seen(grid)
    guess.look(about, on_map)
    return guess, on_map


def test_what_was_looked_at_is_ruled_out_and_what_lies_behind_the_ridge_is_not():
    guess, _ = looked()
    east = guess.places[:, 0] > 2.0
    west = (np.abs(guess.places) < 7.0).all(axis=1) & (guess.places[:, 0] < -0.5)
    assert west.any() and not guess.open[west].any()
    assert guess.open[east].all()


def test_where_the_map_knows_nothing_nobody_is_ruled_out():
    guess, _ = looked(grid_map(unknown=lambda x, y: x > 1.0))
    assert guess.open[guess.places[:, 0] > 2.5].all()
    near = (np.abs(guess.places) < 7.0).all(axis=1) & (guess.places[:, 0] < 0.5)
    assert not guess.open[near].any()


def test_a_place_that_overlooks_the_way_is_likelier_than_one_that_does_not():
    guess, (_, on_map) = belief(), seen()
    weights, x = guess.weights(on_map), guess.places[:, 0]
    assert weights[x < -1.0].mean() > 3.0 * weights[(x > 2.0) & (x < 6.0)].mean()


def test_nobody_stands_in_an_obstacle():
    there = lambda x, y: x < -1.0  # noqa: E731
    guess, (_, on_map) = belief(), seen(grid_map(blocked=there))
    inside = (np.abs(guess.places) < 7.5).all(axis=1) & (guess.places[:, 0] < -1.2)
    assert inside.any() and not guess.weights(on_map)[inside].any()


def test_the_chance_to_be_seen_is_a_share_of_the_attention():
    guess, on_map = looked()
    chance = guess.exposure(on_map)
    assert chance.shape == on_map.grid.shape
    assert chance.min() >= 0.0 and 0.0 < chance.max() <= FEW.attention + 1e-6


def test_once_all_has_been_looked_at_there_is_nothing_to_fear():
    guess, on_map = looked()
    guess.open[:] = False
    assert not guess.exposure(on_map).any()


def test_the_same_seed_gives_the_same_belief():
    (one, on_map), (same, _) = looked(), looked()
    other = SensedBelief(ROUTE, np.random.default_rng(1), FEW)
    assert np.array_equal(one.exposure(on_map), same.exposure(on_map))
    assert not np.array_equal(one.places, other.places)


@pytest.mark.parametrize("x", [-40.0, 40.0])
def test_a_map_that_holds_none_of_the_way_still_has_a_belief(x):
    grid = grid_map()
    far = replace(grid, x_min=grid.x_min + x)
    guess, (about, on_map) = belief(), seen(far)
    guess.look(replace(about, pose=Pose(x, 0.0, 0.0)), on_map)
    assert np.isfinite(guess.exposure(on_map)).all()
