"""What an all-knowing robot perceives: the true map, all cover and all that moves, in the form in which the
sensors would have it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from planner.elevation_map import MapConfig, step_cells, window_origin
from planner.frames import CoverEstimate, GridMap, TrackedObstacle
from planner.tracking import obstacle_radius
from scenes.scenario import CoverObject, MovingObstacle
from scenes.terrain import QUALITIES, SURFACES, Heightmap, Quality, Surface

_VELOCITY_SPAN = 0.05  # seconds over which a beat's velocity is taken


class TrueMap:
    """Cuts the robot's window out of the true ground and cover; the window last cut is kept."""

    def __init__(self, heightmap: Heightmap, cover: Sequence[CoverObject], config: MapConfig):
        self.heightmap, self.cover, self.config = heightmap, tuple(cover), config
        self._grid: GridMap | None = None

    def about(self, x: float, y: float) -> GridMap:
        """The window about a robot at (x, y): true heights, unknown off the map and where the survey has no
        data; obstacles are cover footprints, steps and water; what hangs is not mapped."""
        x_min, y_min = window_origin(x, y, self.config)
        if self._grid is None or (self._grid.x_min, self._grid.y_min) != (x_min, y_min):
            self._grid = self._cut(x_min, y_min)
        return self._grid

    def _cut(self, x_min: float, y_min: float) -> GridMap:
        shape = (self.config.cells, self.config.cells)
        return true_grid(self.heightmap, self.cover, x_min, y_min, shape, self.config)


def true_grid(
    heightmap: Heightmap,
    cover: Sequence[CoverObject],
    x_min: float,
    y_min: float,
    shape: tuple[int, int],
    config: MapConfig,
) -> GridMap:
    """The true ground and cover on any grid of `shape` with cell [0, 0] centred at (x_min, y_min), cells of
    the config's resolution; what it says where is told at `TrueMap.about`."""
    resolution = config.resolution
    x, y = np.meshgrid(x_min + np.arange(shape[1]) * resolution, y_min + np.arange(shape[0]) * resolution)
    west, east, south, north = heightmap.bounds
    row, col = heightmap.cells(x, y)
    known = (x >= west) & (x <= east) & (y >= south) & (y <= north)
    known &= heightmap.quality[row, col] != QUALITIES.index(Quality.MISSING)
    elevation = np.where(known, heightmap.height_at(x, y), np.nan)
    blocked = step_cells(elevation, config)
    blocked |= known & (heightmap.surface[row, col] == SURFACES.index(Surface.WATER))
    span = np.stack([np.full(shape, np.inf, np.float32), np.full(shape, -np.inf, np.float32)])
    for thing in cover:
        place, inside = _cells_under(thing, x_min, y_min, resolution, shape)
        blocked[place] |= inside
        foot = float(heightmap.height_at(thing.x, thing.y))
        span[0][place][inside] = np.minimum(span[0][place][inside], foot)
        span[1][place][inside] = np.maximum(span[1][place][inside], foot + (thing.height or 0.0))
    return GridMap(
        x_min, y_min, resolution,
        elevation.astype(np.float32),
        np.where(known, 0.0, np.nan).astype(np.float32),
        blocked,
        np.full(shape, np.inf, np.float32),
        span,
    )  # fmt: skip


def _cells_under(
    thing: CoverObject, x_min: float, y_min: float, resolution: float, shape: tuple[int, int]
) -> tuple[tuple[slice, slice], np.ndarray]:
    """The part of a grid that holds the footprint, and (rows, cols) bool in it the cells that the footprint
    touches, up to half a cell beyond its outline."""
    outline = thing.footprint
    reach = outline.radius + resolution
    rows, cols = shape
    south, west = outline.y - y_min - reach, outline.x - x_min - reach
    span = math.ceil(2.0 * reach / resolution) + 1
    first_row, first_col = math.floor(south / resolution), math.floor(west / resolution)
    row = np.arange(max(first_row, 0), min(first_row + span + 1, rows))
    col = np.arange(max(first_col, 0), min(first_col + span + 1, cols))
    if not len(row) or not len(col):
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0), bool)
    x, y = np.meshgrid(x_min + col * resolution, y_min + row * resolution)
    inside = outline.distance(np.column_stack([x.ravel(), y.ravel()])) <= 0.5 * resolution
    return (slice(row[0], row[-1] + 1), slice(col[0], col[-1] + 1)), inside.reshape(x.shape)


def true_obstacles(obstacles: Iterable[MovingObstacle], time_s: float) -> tuple[TrackedObstacle, ...]:
    """Every moving obstacle where it is, with its true velocity, by id."""
    tracked = []
    for thing in obstacles:
        x, y, _ = thing.pose_at(time_s)
        ahead_x, ahead_y, _ = thing.pose_at(time_s + _VELOCITY_SPAN)
        vx, vy = (ahead_x - x) / _VELOCITY_SPAN, (ahead_y - y) / _VELOCITY_SPAN
        tracked.append(TrackedObstacle(thing.id, thing.kind, x, y, vx, vy, obstacle_radius(thing.kind)))
    return tuple(sorted(tracked, key=lambda obstacle: obstacle.object_id))


def true_cover(cover: Iterable[CoverObject], heightmap: Heightmap) -> tuple[CoverEstimate, ...]:
    """Every cover object with full confidence, by id; z is the ground's at its middle, width the larger of
    its outer dimensions seen from above."""
    known = (
        CoverEstimate(
            thing.id, thing.kind, thing.x, thing.y, float(heightmap.height_at(thing.x, thing.y)),
            max(thing.footprint.length, thing.length or 0.0, thing.width or 0.0), thing.height or 0.0, 1.0,
        )
        for thing in cover
    )
    return tuple(sorted(known, key=lambda estimate: estimate.object_id))
