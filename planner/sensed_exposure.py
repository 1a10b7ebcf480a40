"""What the observers that the robot knows see of it, as far as its own map tells (`planner.map_sight`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from planner.frames import Percept
from planner.hull_exposure import over_hull
from planner.line_of_sight import View
from planner.map_sight import MapSight
from planner.pace import seconds_to
from scenes.robot import HUSKY
from scenes.scenario import Observer

STRIDE = 2
"""Cells of the map to a cell of the exposure, each way."""

BEAT_TIMES = (0.0, 4.0, 8.0, 12.0, 16.0, 20.0)
"""Seconds from now at which a patrol is looked for; the exposure is the mean over them."""

ARRIVALS = (0.0, 2.0, 4.0, 6.0, 9.0, 12.0, 16.0, 20.0)
"""Seconds from now at which those who walk are looked for by a robot that sets off now."""

UNSURE = (1.0, 0.25)
"""Standard deviation of the arrival: seconds, and a share of the seconds till then."""


def sensed_exposure(percept: Percept, on_map: MapSight | None = None) -> np.ndarray:
    """(rows, cols) float32 over `percept.grid`: the visible fraction, from 0 to 1, of a robot that stands in
    each cell, the mean over its headings and over the beats of those who walk, united over the known
    observers. `on_map` spares its making.
    """
    times = BEAT_TIMES if _somebody_walks(percept) else BEAT_TIMES[:1]
    return _mean_exposure(percept, times, lambda _: np.full((len(times), 1), 1.0 / len(times)), on_map)


def exposure_on_arrival(percept: Percept) -> np.ndarray:
    """As `sensed_exposure`, but of a robot that sets off for each cell now: those who walk count where they
    will be when it gets there."""
    if not _somebody_walks(percept):
        return sensed_exposure(percept)
    return _mean_exposure(percept, ARRIVALS, lambda middle: _shares(percept, middle))


def _somebody_walks(percept: Percept) -> bool:
    return any(observer.patrol is not None for observer in percept.observers)


def _shares(percept: Percept, middle: np.ndarray) -> np.ndarray:
    """(times, cells) what each of `ARRIVALS` counts for cells (n, 3): most when the robot gets there, and the
    later that is the less it is sure."""
    arrival = np.minimum(seconds_to(percept.pose, middle[:, 0], middle[:, 1]), ARRIVALS[-1])
    times = np.array(ARRIVALS)[:, None]
    near = np.exp(-0.5 * ((times - arrival) / (UNSURE[0] + UNSURE[1] * arrival)) ** 2)
    shares = np.gradient(times[:, 0])[:, None] * near
    return shares / shares.sum(axis=0)


def _mean_exposure(
    percept: Percept,
    times: Sequence[float],
    shares: Callable[[np.ndarray], np.ndarray],
    on_map: MapSight | None = None,
) -> np.ndarray:
    """The mean over times, seconds from now, of what the observers see.

    shares : from the middles (n, 3) of robots that stand in n cells to what each time counts for them,
        (times, n), or (times, 1) where that is the same for all
    """
    grid = percept.grid
    if not percept.observers:
        return np.zeros(grid.shape, np.float32)
    on_map = on_map or MapSight.of(percept)
    ground = on_map.ground
    rows, cols = (np.arange((size % STRIDE) // 2, size, STRIDE) for size in grid.shape)
    row, col = (part.ravel() for part in np.meshgrid(rows, cols, indexing="ij"))
    heights = np.unique(HUSKY.hull_points()[:, 2])
    light = np.zeros((len(row), len(heights)), np.float32)
    middle = np.column_stack(
        [
            grid.x_min + col * grid.resolution,
            grid.y_min + row * grid.resolution,
            ground[row, col] + heights[-1],
        ]
    )
    sights: dict[View, tuple[np.ndarray, np.ndarray]] = {}
    for ahead, share in zip(times, shares(middle).astype(np.float32), strict=True):
        united = np.zeros_like(light)
        for view in views_on_map(percept, ground, ahead):
            if view not in sights:
                held = np.flatnonzero(view.holds(middle))
                sights[view] = held, on_map.light(view.eye, row[held], col[held], heights)
            held, seen = sights[view]
            united[held] = np.maximum(united[held], seen)
        light += share[:, None] * united
    levels = light.T.reshape(len(heights), len(rows), len(cols))
    coarse = over_hull(levels, STRIDE * grid.resolution).mean(axis=0)
    return spread(coarse, STRIDE, grid.shape)


def spread(coarse: np.ndarray, stride: int, shape: tuple[int, int]) -> np.ndarray:
    """A layer of `shape` from one whose every cell stands for `stride` cells each way."""
    return np.repeat(np.repeat(coarse, stride, axis=0), stride, axis=1)[: shape[0], : shape[1]]


def views_on_map(percept: Percept, ground: np.ndarray, ahead: float) -> list[View]:
    """The known observers' views `ahead` seconds from now; those that walk stand on the map's ground."""
    return [
        _view(observer, eye, percept, ground, ahead)
        for observer, eye in zip(percept.observers, percept.observer_eyes, strict=True)
    ]


def _view(
    observer: Observer, eye: tuple[float, float, float], percept: Percept, ground: np.ndarray, ahead: float
) -> View:
    x, y, yaw = observer.pose_at(percept.time_s + ahead)
    z, grid = eye[2], percept.grid
    if ahead > 0.0 and observer.patrol is not None and grid.contains(x, y):
        z = float(ground[grid.cell(x, y)]) + observer.eye_height
    return View(
        observer.id, float(x), float(y), z, float(yaw),
        math.radians(observer.fov_horizontal), math.radians(observer.fov_vertical), observer.range,
    )  # fmt: skip
