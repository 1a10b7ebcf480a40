"""Grounds to stand things on, for the tests of the world and its senses."""

import math

import numpy as np

from scenes.scenario import CoverObject
from scenes.terrain import Heightmap


def ground(height=lambda x, y: 0.0 * x, rows=97, columns=97, resolution=0.25) -> Heightmap:
    """A heightmap of grass whose heights are a function of x and y."""
    zeros = np.zeros((rows, columns), np.uint8)
    x, y = Heightmap(np.zeros((rows, columns)), resolution, zeros, zeros).xy()
    return Heightmap(height(x, y), resolution, zeros, zeros)


def slope(degrees: float) -> Heightmap:
    """Rises toward +x."""
    return ground(lambda x, y: x * math.tan(math.radians(degrees)))


def rough(seed: int, rows=97, columns=97, resolution=0.25, relief=0.3) -> Heightmap:
    """Independent heights at every sample: no symmetry, every triangle its own."""
    rng = np.random.default_rng(seed)
    return ground(lambda x, y: relief * rng.random(x.shape), rows, columns, resolution)


def thing(kind: str, x: float, y: float, **fields) -> CoverObject:
    return CoverObject(id=fields.pop("id", 1), kind=kind, x=float(x), y=float(y), **fields)
