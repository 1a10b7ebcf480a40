"""The cost map read off the attention: as published, and without its traps."""

import numpy as np
import pytest

from planner.attention_cost import IMPASSABLE, attention_map, cost_map

EVEN = np.ones((8, 20, 20), np.float32)
ROW, COL = np.mgrid[:40, :40]


def plateau(height):
    """Flat ground with a flat, raised (or sunk) middle whose edge is a gentle ramp."""
    away = np.maximum(np.abs(ROW - 19.5), np.abs(COL - 19.5)) * 0.5
    return height * np.clip((7.0 - away) / 3.0, 0.0, 1.0)


def test_a_place_stands_for_the_cells_it_was_made_from():
    attended = np.arange(2 * 400, dtype=float).reshape(2, 20, 20)
    attention = attention_map(attended)
    assert attention.shape == (40, 40)
    assert (attention[6:8, 10:12] == attended[:, 3, 5].sum()).all()


def test_as_published_a_flat_plateau_is_barred_and_a_pit_free():
    assert cost_map(EVEN, plateau(0.4), literal=True)[20, 20] == IMPASSABLE
    assert cost_map(EVEN, plateau(-0.4), literal=True)[20, 20] == 0.0


@pytest.mark.parametrize("height", [0.4, -0.4])
def test_a_plateau_and_a_pit_cost_nothing_but_on_their_edge(height):
    cost = cost_map(EVEN, plateau(height))
    assert cost[20, 20] == 0.0
    assert 0.0 < cost[20, 8] < 80.0


def test_as_published_something_is_always_barred():
    bumps = 0.01 * np.sin(ROW) * np.cos(COL)
    assert (cost_map(EVEN, bumps, literal=True) == IMPASSABLE).any()
    assert cost_map(EVEN, bumps).max() < 20.0


def test_a_cliff_is_barred():
    cliff = np.where(COL > 25, 3.0, 0.0)
    cost = cost_map(EVEN, cliff)
    assert (cost[5:35, 25:27] == IMPASSABLE).all() and cost[20, 10] == 0.0


def test_attention_makes_the_same_slope_dearer():
    attended = EVEN.copy()
    attended[:, :10] = 3.0
    cost = cost_map(attended, 0.1 * COL * 0.5)
    assert cost[5, 20] > 1.5 * cost[30, 20] > 0.0


@pytest.mark.parametrize("literal", [True, False])
@pytest.mark.parametrize("attended", [EVEN, 0.0 * EVEN])
def test_level_ground_and_blind_attention_divide_by_nothing(literal, attended):
    cost = cost_map(attended, np.zeros((40, 40)), literal=literal)
    assert cost.dtype == np.float32 and (cost == 0.0).all()
