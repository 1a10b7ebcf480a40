"""The cost map that TERP reads off its network: attention times elevation.

Taken literally it has two traps. The height is what counts, not its change: a flat plateau is dear and a pit
is cheap. And the least and the greatest product of the patch are made 0 and 100: the bumps of a meadow become
as dear as a cliff, and something is always barred. `literal=True` keeps both; else the steepness takes the
height's place, in shares of what the robot climbs, and the attention weighs it against its own mean.
"""

from __future__ import annotations

import math

import numpy as np

from planner.cost_map import surface_shape
from scenes.robot import HUSKY

PATCH_RESOLUTION = 0.5
"""Metres a cell of the elevation."""

DEAREST, BARRED, IMPASSABLE = 100.0, 80.0, 1000.0
"""The most that a cell costs, from which cost on it is barred, and what a barred one costs instead."""

LEAST_WEIGHT, MOST_WEIGHT = 0.5, 2.0
"""Bounds of a place's attention over the mean attention."""


def attention_map(attended: np.ndarray, cells: int = 40) -> np.ndarray:
    """(cells, cells) sum over the channels of features after the attention (channels, n, n), each place
    repeated over the cells that it stands for."""
    total = attended.sum(0)
    times = cells // len(total)
    return np.repeat(np.repeat(total, times, 0), times, 1)


def cost_map(attended: np.ndarray, elevation: np.ndarray, literal: bool = False) -> np.ndarray:
    """(40, 40) float32 cost of the cells: 0 to 80, or 1000 where barred.

    attended : (channels, 20, 20) the network's features after the attention
    elevation : (40, 40) metres above the robot, body frame as `Percept.elevation_patch`
    literal : as published, with its traps
    """
    attention = attention_map(attended, len(elevation))
    if literal:
        product = attention * elevation
        low, high = float(product.min()), float(product.max())
        cost = DEAREST * (product - low) / (high - low) if high > low else np.zeros_like(product)
    else:
        gradient, _ = surface_shape(elevation, PATCH_RESOLUTION)
        steepness = np.minimum(np.nan_to_num(gradient / math.tan(HUSKY.max_slope)), 1.0)
        mean = float(attention.mean())
        weight = np.clip(attention / mean, LEAST_WEIGHT, MOST_WEIGHT) if mean > 0.0 else 1.0
        cost = np.minimum(DEAREST * steepness * weight, DEAREST)
    return np.where(cost >= BARRED, IMPASSABLE, cost).astype(np.float32)
