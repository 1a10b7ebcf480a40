"""How much of the robot would be seen in each cell, by the way it heads: what covert routes are made of.

A drive's exposure is logged on `HUSKY.hull_points()`. Here the same points are looked up in exposure fields
at the hull's heights over the ground, so that planned and logged exposure are one thing.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from planner.exposure import common_cycle, exposure_field, time_averaged, views_at
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.terrain import Heightmap

HEADINGS = np.radians([0.0, 45.0, 90.0, 135.0])
"""The hull is the same turned half round, so four headings stand for eight."""

TIMES = 16  # at which a cycle of patrols is sampled


@dataclass(frozen=True, eq=False)
class HullExposure:
    """Cell [0, 0] is centred at (x_min, y_min).

    fraction : (4, rows, cols) float32 united visible fraction of a robot that stands level with the ground
        and heads along `HEADINGS` or against them; over the patrols' cycle its mean. Cells without data
        count as seen.
    """

    x_min: float
    y_min: float
    resolution: float
    fraction: np.ndarray

    @property
    def anywhere(self) -> np.ndarray:
        """(rows, cols) float32: the mean over the headings."""
        return self.fraction.mean(axis=0)


def hull_exposure(
    rays: RayScene, heightmap: Heightmap, observers: Sequence[Observer], *, stride: int = 1
) -> HullExposure:
    """The field over every `stride`-th cell of the map: a ray for each cell, observer and hull height."""
    heights = np.unique(HUSKY.hull_points()[:, 2])
    if common_cycle(observers):
        fields = [
            time_averaged(rays, heightmap, observers, samples=TIMES, stride=stride, height=float(height))
            for height in heights
        ]
    else:
        views = views_at(observers, heightmap, 0.0)
        fields = [
            exposure_field(rays, heightmap, views, stride=stride, height=float(height)) for height in heights
        ]
    light = np.stack([np.nan_to_num(field.united, nan=1.0) for field in fields])
    some = fields[0]
    return HullExposure(some.x_min, some.y_min, some.resolution, over_hull(light, some.resolution))


def over_hull(light: np.ndarray, resolution: float) -> np.ndarray:
    """The mean over the hull's points by heading, (4, rows, cols) float32.

    light : (3, rows, cols) share of light at the hull's three heights, lowest first; between cells it is
        interpolated, beyond the grid its border goes on
    """
    stencils = [_stencil(float(heading), resolution) for heading in HEADINGS]
    reach = max(max(abs(row), abs(col)) for stencil in stencils for _, row, col in stencil)
    padded = np.pad(np.asarray(light, np.float32), ((0, 0), (reach, reach), (reach, reach)), mode="edge")
    rows, cols = light.shape[1:]
    fraction = np.zeros((len(HEADINGS), rows, cols), np.float32)
    for mean, stencil in zip(fraction, stencils, strict=True):
        for (level, row, col), weight in stencil.items():
            window = padded[level, reach + row : reach + row + rows, reach + col : reach + col + cols]
            mean += np.float32(weight) * window
    return fraction


@cache
def _stencil(heading: float, resolution: float) -> dict[tuple[int, int, int], float]:
    """Weights by height's index, row and column relative to the robot's cell, of all hull points together."""
    hull = HUSKY.hull_points()
    levels = np.unique(hull[:, 2], return_inverse=True)[1]
    cos, sin = math.cos(heading), math.sin(heading)
    cols = (cos * hull[:, 0] - sin * hull[:, 1]) / resolution
    rows = (sin * hull[:, 0] + cos * hull[:, 1]) / resolution
    weights: dict[tuple[int, int, int], float] = defaultdict(float)
    for level, row, col in zip(levels, rows, cols, strict=True):
        south, west = math.floor(row), math.floor(col)
        for r, row_share in ((south, 1.0 - row + south), (south + 1, row - south)):
            for c, col_share in ((west, 1.0 - col + west), (west + 1, col - west)):
                if row_share * col_share > 1e-9:
                    weights[int(level), r, c] += float(row_share * col_share) / len(hull)
    return dict(weights)
