"""Where an observer not yet seen may stand."""

import numpy as np
import pytest
from lookouts import ridge, stage, thing

from planner.belief import Belief, BeliefConfig
from planner.methods.wary import Wary
from scenes.pose import Pose

ROUTE = ((-4.0, -3.0), (-4.0, 3.0))
FEW = BeliefConfig(places=120, drawn=60)


def belief(heights=None, cover=(), seed=0, config=FEW, **fields):
    heightmap, rays = stage(heights, cover, **fields)
    return Belief(rays, heightmap, cover, ROUTE, np.random.default_rng(seed), config)


def standing(x, y, heights=None):
    return Pose(x, y, 0.0 if heights is None else float(heights(np.array(x), np.array(y))))


def test_the_places_are_where_a_watcher_may_stand_and_the_weights_are_a_distribution():
    wood = [thing("cottage", 5.0, 0.0)]
    guess = belief(cover=wood)
    assert guess.weights.sum() == pytest.approx(1.0) and guess.weights.shape == (len(guess.places),)
    assert wood[0].footprint.distance(guess.places).min() > 0.5
    assert np.abs(guess.places).max() <= 10.0


def test_a_good_vantage_is_likelier_than_a_poor_one():
    """The ridge hides the way from the east; its crest looks over it."""
    guess = belief(ridge)
    x = guess.places[:, 0]
    behind, before = (x > 2.0) & (x < 6.0), x < -1.0
    assert guess.weights[before].mean() > 3.0 * guess.weights[behind].mean()


def test_what_was_looked_at_drops_out_and_the_rest_gains():
    guess = belief(ridge)
    before = guess.weights.copy()
    guess.look(standing(-4.0, 0.0))
    east = guess.places[:, 0] > 2.0
    west = guess.places[:, 0] < -0.5
    assert not guess.weights[west].any() and guess.weights[east].sum() > before[east].sum()
    assert guess.weights.sum() == pytest.approx(1.0)


def test_beyond_the_detection_range_nothing_is_ruled_out():
    guess = belief()
    guess.look(standing(-9.0, 0.0), reach=4.0)
    far = np.hypot(guess.places[:, 0] + 9.0, guess.places[:, 1]) > 4.5
    assert guess.weights[far].all() and not guess.weights[~far].all()


def test_once_all_has_been_looked_at_nothing_is_left_to_fear():
    guess = belief()
    guess.look(standing(0.0, 0.0))
    assert guess.weights.sum() == 0.0 and not guess.exposure().any()
    guess.look(standing(0.0, 0.0))


def test_the_layer_is_the_mean_of_what_the_places_see():
    guess = belief(ridge, config=BeliefConfig(places=60, drawn=400, attention=0.5))
    layer = guess.exposure(stride=2)
    assert layer.shape == (21, 21) and 0.0 <= layer.min() < layer.max() <= 0.5
    heightmap, rays = stage(ridge)
    row, col = 10, 4
    x, y = heightmap.x_min + 2 * col * 0.5, heightmap.y_min + 2 * row * 0.5
    spot = np.array([x, y, float(heightmap.height_at(x, y)) + 0.39])
    eyes = np.column_stack([guess.places, heightmap.height_at(*guess.places.T) + 1.7])
    expected = 0.5 * (guess.weights * rays.visible(eyes, np.tile(spot, (len(eyes), 1)))).sum()
    assert layer[row, col] == pytest.approx(expected, abs=0.01)


def test_ground_without_data_is_unknown_and_nobody_stands_there():
    missing = np.zeros((41, 41), bool)
    missing[:, 30:] = True
    guess = belief(missing=missing)
    assert np.isnan(guess.exposure()[missing]).all() and guess.places[:, 0].max() < 5.0


def test_the_same_seed_gives_the_same_belief():
    one, same, other = belief(ridge), belief(ridge), belief(ridge, seed=1)
    np.testing.assert_array_equal(one.exposure(), same.exposure())
    assert not np.array_equal(one.places, other.places)


def test_without_a_briefing_it_cannot_decide():
    with pytest.raises(RuntimeError, match="briefed"):
        Wary("route_wary", believes=True).decide(None)
