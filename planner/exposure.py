"""Exposure: who sees which cell of the scene, now and over the observers' beats.

Metres, seconds, radians, world frame. A cell's exposure to an observer is the share of light from 0 to 1 that
reaches the observer's eye from `HUSKY.height` above the cell's ground: 0 hidden, 1 in plain view, in between
through trees, bushes and fences. From `SEEN` on, a cell counts as seen.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from planner.line_of_sight import SEEN, View, VisibleFraction, views_at, visible_fraction
from planner.sight_profile import SightProfile, sight_profile
from planner.viewshed import viewshed, viewsheds
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.terrain import QUALITIES, Heightmap, Quality

__all__ = [
    "SEEN",
    "ExposureField",
    "SightProfile",
    "View",
    "VisibleFraction",
    "exposure_field",
    "sight_profile",
    "time_averaged",
    "views_at",
    "viewshed",
    "viewsheds",
    "visible_fraction",
]

LONGEST_CYCLE = 12  # beats of the slowest patrol, where the beats have no common cycle


@dataclass(frozen=True, eq=False)
class ExposureField:
    """What each observer sees of a robot standing in each cell; cell [0, 0] is centred at (x_min, y_min).

    observer_ids : in the order of `seen`
    seen : (n_obs, rows, cols) float32 exposure from 0 to 1, a mean over time where the field is one;
        NaN where unknown
    unknown : (rows, cols) bool, cells without data, which are neither seen nor hidden
    joint : (rows, cols) float32 united exposure where it is not the largest of `seen`: a mean over time
    """

    x_min: float
    y_min: float
    resolution: float
    observer_ids: tuple[int, ...]
    seen: np.ndarray
    unknown: np.ndarray
    joint: np.ndarray | None = field(default=None, repr=False)

    @cached_property
    def united(self) -> np.ndarray:
        """(rows, cols) float32 exposure to the observer who sees best, NaN where unknown."""
        if self.joint is not None:
            return self.joint
        hidden = np.where(self.unknown, np.float32(np.nan), np.float32(0.0))
        return self.seen.max(axis=0) if len(self.seen) else hidden

    @cached_property
    def count(self) -> np.ndarray:
        """(rows, cols) int32 number of observers who see the cell, -1 where unknown."""
        return np.where(self.unknown, -1, np.count_nonzero(self.seen >= SEEN, axis=0)).astype(np.int32)

    def of(self, observer_id: int) -> np.ndarray:
        """(rows, cols) exposure to one observer. Raises KeyError for one who is not in the field."""
        if observer_id not in self.observer_ids:
            raise KeyError(f"there is no observer {observer_id} in this field")
        return self.seen[self.observer_ids.index(observer_id)]

    def share(self, exposure: np.ndarray) -> float:
        """Share of the known cells that are seen in `united` or `of(...)`; 0 where nothing is known."""
        known = int(np.count_nonzero(~self.unknown))
        return float(np.count_nonzero(exposure >= SEEN)) / known if known else 0.0

    def area(self, exposure: np.ndarray) -> float:
        """Square metres that are seen in `united` or `of(...)`."""
        return float(np.count_nonzero(exposure >= SEEN)) * self.resolution**2

    def mean(self, exposure: np.ndarray) -> float:
        """Mean of `united` or `of(...)` over the known cells; 0 where nothing is known."""
        known = exposure[~self.unknown]
        return float(known.mean()) if len(known) else 0.0

    @property
    def unknown_area(self) -> float:
        """Square metres without data."""
        return float(np.count_nonzero(self.unknown)) * self.resolution**2


def exposure_field(
    rays: RayScene,
    heightmap: Heightmap,
    views: Sequence[View],
    *,
    stride: int = 1,
    height: float = HUSKY.height,
) -> ExposureField:
    """The field of the views as they are, over every `stride`-th cell of the map, one ray a cell and view.

    Moving obstacles hide where `rays` has them. Raises ValueError for a stride below 1.
    """
    x_min, y_min, points, unknown = _cells(heightmap, stride, height)
    seen = np.zeros((len(views), *unknown.shape), np.float32)
    known = ~unknown
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for index, light in enumerate(pool.map(lambda view: _seen_by(rays, view, points), views)):
            seen[index, known] = light
    seen[:, unknown] = np.nan
    ids = tuple(view.observer_id for view in views)
    return ExposureField(x_min, y_min, heightmap.resolution * stride, ids, seen, unknown)


def time_averaged(
    rays: RayScene,
    heightmap: Heightmap,
    observers: Sequence[Observer],
    *,
    samples: int = 24,
    stride: int = 1,
    height: float = HUSKY.height,
) -> ExposureField:
    """The field's mean over the patrols' common cycle, at `samples` times spread evenly over it.

    Beats without a common cycle of less than twelve of the slowest are averaged over those twelve.
    Raises ValueError for a stride or a number of samples below 1.
    """
    if samples < 1:
        raise ValueError(f"at least one sample is needed, got {samples}")
    cycle = common_cycle(observers)
    times = (np.arange(samples) + 0.5) * cycle / samples if cycle else np.zeros(1)
    x_min, y_min, points, unknown = _cells(heightmap, stride, height)
    total = np.zeros((len(observers), len(points)))
    joint = np.zeros(len(points))
    standing: dict[int, np.ndarray] = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for time_s in times:
            views = views_at(observers, heightmap, float(time_s))
            looking = [row for row in range(len(views)) if row not in standing]
            lights = pool.map(lambda view: _seen_by(rays, view, points), [views[row] for row in looking])
            now = standing | dict(zip(looking, lights, strict=True))
            standing = {row: light for row, light in now.items() if not beat_period(observers[row])}
            for row, light in now.items():
                total[row] += light
            joint += np.max(list(now.values()), axis=0, initial=0.0) if now else 0.0
    layers = np.full((len(observers) + 1, *unknown.shape), np.nan, np.float32)
    layers[:, ~unknown] = np.vstack([total, joint]) / len(times)
    ids = tuple(observer.id for observer in observers)
    return ExposureField(x_min, y_min, heightmap.resolution * stride, ids, layers[:-1], unknown, layers[-1])


def beat_period(observer: Observer) -> float:
    """Seconds after which a patrol is where it was and looks as it did; 0 for one who stands still."""
    patrol = observer.patrol
    if patrol is None:
        return 0.0
    points = [(observer.x, observer.y), *((point.x, point.y) for point in patrol.waypoints)]
    course = [*points, points[0]] if patrol.loop else [*points, *reversed(points[:-1])]
    return sum(math.dist(a, b) for a, b in pairwise(course)) / patrol.speed


def common_cycle(observers: Sequence[Observer]) -> float:
    """Seconds after which all patrols are where they were, to a twentieth of a second; 0 where nobody walks.
    At most `LONGEST_CYCLE` beats of the slowest."""
    beats = [max(1, round(20.0 * period)) for period in map(beat_period, observers) if period > 0.0]
    if not beats:
        return 0.0
    return min(math.lcm(*beats), LONGEST_CYCLE * max(beats)) / 20.0


def _cells(
    heightmap: Heightmap, stride: int, height: float
) -> tuple[float, float, np.ndarray, np.ndarray]:
    """x_min and y_min of a strided grid, the points (n, 3) over its known cells, and (rows, cols) unknown."""
    if stride < 1:
        raise ValueError(f"the stride must be at least 1, got {stride}")
    offset = min((stride - 1) // 2, min(heightmap.shape) - 1)
    pick = (slice(offset, None, stride),) * 2
    x, y = (axis[pick] for axis in heightmap.xy())
    unknown = heightmap.quality[pick] == QUALITIES.index(Quality.MISSING)
    known = ~unknown
    points = np.column_stack([x[known], y[known], heightmap.heights[pick][known] + height])
    return float(x[0, 0]), float(y[0, 0]), points, unknown


def _seen_by(rays: RayScene, view: View, points: np.ndarray) -> np.ndarray:
    """(n,) float32 exposure of points (n, 3)."""
    seen = np.zeros(len(points), np.float32)
    held = view.holds(points)
    if held.any():
        seen[held] = rays.visible(view.eye, points[held])
    return seen
