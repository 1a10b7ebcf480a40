"""What it costs to drive over each cell of the robot's own map: named layers and their sum."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from scipy.ndimage import distance_transform_edt

from planner.dwa import Ground
from planner.frames import CostPatch, GridMap
from scenes.robot import HUSKY


@dataclass(frozen=True)
class CostConfig:
    """Weights in points of 0..100, the cost of a cell where a layer is at its worst; metres and radians.

    slope : at the steepest drivable ground, growing with the square of the tangent
    roughness : where neighbouring cells stray from the local plane by `max_roughness`
    obstacle : at the edge of the forbidden rim, falling to nothing at `obstacle_reach`
    unknown : where nothing is known
    rim : nearer to a mapped obstacle the robot's centre must not come
    max_slope : steeper ground is forbidden; a degree more than the robot climbs, for maps are not exact
    """

    slope: float = 35.0
    roughness: float = 15.0
    obstacle: float = 80.0
    unknown: float = 8.0
    rim: float = HUSKY.inscribed_radius + 0.14
    obstacle_reach: float = 1.3
    max_slope: float = HUSKY.max_slope + math.radians(1.0)
    max_roughness: float = 0.08


@dataclass(frozen=True)
class CostMap:
    """Cost layers over a world-aligned grid, cell [0, 0] centred at (x_min, y_min).

    layers : name -> (rows, cols) float, points of 0..100
    forbidden : (rows, cols) bool, where the robot's centre must not be
    unknown : (rows, cols) bool
    clearance : (rows, cols) metres to the nearest cell that blocks the robot's body, inf where none does that
        is near enough to cost anything
    tight : (rows, cols) bool, forbidden for its margin alone: the body would fit
    """

    x_min: float
    y_min: float
    resolution: float
    layers: Mapping[str, np.ndarray]
    forbidden: np.ndarray
    unknown: np.ndarray
    clearance: np.ndarray
    tight: np.ndarray

    @cached_property
    def total(self) -> np.ndarray:
        """(rows, cols) float: the layers' sum, at most 100, inf where forbidden."""
        total = np.minimum(np.sum(list(self.layers.values()), axis=0), 100.0)
        return np.where(self.forbidden, np.inf, total)

    def patch(self) -> CostPatch:
        """The sum for drawing: unknown cells are NaN unless forbidden."""
        cost = self.total.astype(np.float32)
        cost[self.unknown & ~self.forbidden] = np.nan
        return CostPatch(self.x_min, self.y_min, self.resolution, cost)

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """(row, col) of the cell that holds a world point; may lie outside the grid."""
        return round((y - self.y_min) / self.resolution), round((x - self.x_min) / self.resolution)

    def centre(self, row, col) -> np.ndarray:
        """(..., 2) world points of cell centres."""
        return np.stack(
            [self.x_min + self.resolution * np.asarray(col), self.y_min + self.resolution * np.asarray(row)],
            -1,
        )

    def within(self, radius: float, place: tuple[float, float]) -> np.ndarray:
        """(rows, cols) bool: cells whose centres are at most `radius` metres from a place (world x, y)."""
        points = self.centre(*np.indices(self.forbidden.shape))
        return np.hypot(points[..., 0] - place[0], points[..., 1] - place[1]) <= radius


def build(grid: GridMap, config: CostConfig) -> CostMap:
    """Slope, roughness, obstacle and unknown layers of the robot's map."""
    gradient, roughness = ground_shape(grid)
    unknown = grid.unknown
    steepness = np.nan_to_num(gradient / math.tan(config.max_slope))
    uneven = np.nan_to_num(roughness / config.max_roughness)
    distance = obstacle_distance(grid, max(config.obstacle_reach, config.rim))
    near = 1.0 - (distance - config.rim) / (config.obstacle_reach - config.rim)
    layers = {
        "slope": config.slope * np.minimum(steepness, 1.0) ** 2,
        "roughness": config.roughness * np.minimum(uneven, 1.0),
        "obstacle": config.obstacle * np.clip(near, 0.0, 1.0) ** 2,
        "unknown": config.unknown * unknown,
    }
    rim, steep = distance < config.rim, steepness > 1.0
    tight = rim & ~steep & (distance > HUSKY.inscribed_radius)
    return CostMap(grid.x_min, grid.y_min, grid.resolution, layers, rim | steep, unknown, distance, tight)


def shunning(cost_map: CostMap, places: Sequence[tuple[float, float]], berth: float) -> CostMap:
    """The map with a layer `shunned`, at its worst within `berth` metres of places (world x, y) where a drive
    has failed."""
    near = np.zeros(cost_map.forbidden.shape, bool)
    for place in places:
        near |= cost_map.within(berth, place)
    return replace(cost_map, layers={**cost_map.layers, "shunned": 100.0 * near})


def obstacle_distance(grid: GridMap, reach: float = math.inf) -> np.ndarray:
    """(rows, cols) metres to the nearest cell that blocks the robot's body, inf where none does within
    `reach`."""
    if not grid.obstacle.any():
        return np.full(grid.shape, np.inf)
    if math.isinf(reach):
        return distance_transform_edt(~grid.obstacle, sampling=grid.resolution)  # type: ignore[return-value]
    return _distance_within(grid.obstacle, grid.resolution, reach)


@njit(cache=True)
def _distance_within(obstacle, resolution, reach):
    """As `obstacle_distance`, from the edges of what stands there outward."""
    rows, cols = obstacle.shape
    cells = int(reach / resolution + 1e-9)
    away = np.empty((cells + 1, cells + 1))
    for r in range(cells + 1):
        for c in range(cells + 1):
            away[r, c] = math.sqrt((r * resolution) ** 2 + (c * resolution) ** 2)
    distance = np.full((rows, cols), np.inf)
    for row in range(rows):
        for col in range(cols):
            if not obstacle[row, col]:
                continue
            distance[row, col] = 0.0
            inner = 0 < row < rows - 1 and 0 < col < cols - 1
            if (
                inner
                and obstacle[row - 1, col]
                and obstacle[row + 1, col]
                and obstacle[row, col - 1]
                and obstacle[row, col + 1]
            ):
                continue
            for r in range(max(row - cells, 0), min(row + cells + 1, rows)):
                for c in range(max(col - cells, 0), min(col + cells + 1, cols)):
                    there = away[abs(r - row), abs(c - col)]
                    if there <= reach and there < distance[r, c]:
                        distance[r, c] = there
    return distance


def ground_shape(grid: GridMap) -> tuple[np.ndarray, np.ndarray]:
    """`surface_shape` of the ground alone: what stands on it does not make the cells beside it steep."""
    return surface_shape(np.where(grid.obstacle, np.nan, grid.elevation), grid.resolution)


def surface_shape(elevation: np.ndarray, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """The ground about each cell as a plane through the known cells of its 3 × 3 neighbourhood.

    Returns the plane's gradient (rows, cols), rise over run, and the root mean square of what strays from it
    in metres; NaN where fewer than six of the nine, or the cell itself, are unknown.
    """
    return _surface_shape(np.ascontiguousarray(elevation, dtype=float), resolution)


@njit(cache=True)
def _surface_shape(elevation, resolution):
    rows, cols = elevation.shape
    gradient, roughness = np.full((rows, cols), np.nan), np.full((rows, cols), np.nan)
    for row in range(rows):
        for col in range(cols):
            if math.isnan(elevation[row, col]):
                continue
            count, total = 0, 0.0
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for c in range(max(col - 1, 0), min(col + 2, cols)):
                    if not math.isnan(elevation[r, c]):
                        count += 1
                        total += elevation[r, c]
            if count < 6:
                continue
            # With the mean in the gaps, the plane is the regular grid's own least-squares fit.
            mean, east, north, square = total / count, 0.0, 0.0, 0.0
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                for c in range(max(col - 1, 0), min(col + 2, cols)):
                    if not math.isnan(elevation[r, c]):
                        offset = elevation[r, c] - mean
                        east += (c - col) * offset
                        north += (r - row) * offset
                        square += offset * offset
            gradient[row, col] = math.hypot(east, north) / (6.0 * resolution)
            stray = max(square - (east * east + north * north) / 6.0, 0.0)
            roughness[row, col] = math.sqrt(stray / count)
    return gradient, roughness


def open_about(
    cost: np.ndarray,
    cost_map: CostMap,
    centre: np.ndarray,
    radius: float,
    dearest: float,
    blocked: np.ndarray,
) -> None:
    """Let forbidden cells about a world point that hold no obstacle be passed at the highest cost."""
    row, col = cost_map.cell(*centre)
    reach = math.ceil(radius / cost_map.resolution)
    rows = slice(max(row - reach, 0), max(row + reach + 1, 0))
    cols = slice(max(col - reach, 0), max(col + reach + 1, 0))
    window = cost[rows, cols]
    if window.size:
        window[np.isinf(window) & ~blocked[rows, cols]] = dearest


def ground_near(grid: GridMap, x: float, y: float, reach: float, config: CostConfig) -> Ground:
    """The map within `reach` metres of (x, y), as the dynamic window looks at it."""
    row, col = grid.cell(x, y)
    cells = math.ceil(reach / grid.resolution)
    top, left = max(row - cells, 0), max(col - cells, 0)
    window = slice(top, max(row + cells + 1, 0)), slice(left, max(col + cells + 1, 0))
    near = replace(
        grid,
        x_min=grid.x_min + left * grid.resolution,
        y_min=grid.y_min + top * grid.resolution,
        elevation=grid.elevation[window],
        obstacle=grid.obstacle[window],
    )
    gradient, _ = ground_shape(near)
    return Ground(
        near.x_min,
        near.y_min,
        near.resolution,
        near.elevation.astype(float),
        np.nan_to_num(gradient) > math.tan(config.max_slope),
    )
