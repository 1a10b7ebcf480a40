"""From the classified returns of a laser survey to ground, water, trees, bushes and buildings."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree

from scenes.georeference import SceneGrid
from scenes.ground import (
    INTERPOLATED,
    MEASURED,
    MISSING,
    SurveyGround,
    connected,
    interpolate,
    surface_by_slope,
)
from scenes.point_cloud import PointCloud
from scenes.scenario import ScenarioError
from scenes.terrain import SURFACES, Surface

GROUND, BUILDING, WATER = 2, 6, 9
VEGETATION = (3, 4, 5)
UNCLASSIFIED = 1
WATER_INDEX = SURFACES.index(Surface.WATER)
STILL_WATER_SPREAD = 0.6
RESOLUTIONS = (0.25, 0.5, 1.0, 2.0)
GAP_SPACINGS = 2.5
GAP_LIMITS = (3.0, 8.0)


def ground_from_points(cloud: PointCloud, resolution: float | None) -> SurveyGround:
    """The ground on a grid by Delaunay triangles between the mean ground return of each cell.

    A cell that holds a ground (or water) return is measured. One between returns is interpolated. Outside
    their hull, and in gaps, it is missing and takes the nearest height; a gap is farther from the nearest
    return than 2.5 times their mean spacing (3 to 8 m), or more than twice as wide. Water is where the
    nearest return is water; still water is levelled, and its level counts as known throughout.
    Without a wish the resolution is about a third of the spacing: 0.25, 0.5, 1 or 2 m.
    Raises ScenarioError where no return is classified as ground.
    """
    on_ground = cloud.classes == GROUND
    count = int(on_ground.sum())
    if count < 3:
        raise ScenarioError(
            f"has {count} returns of class 2 (ground) in the chosen part: classify the ground first "
            "(PDAL's filters.smrf, lidR's classify_ground)"
        )
    chosen = on_ground | (cloud.classes == WATER)
    spacing = ground_spacing(cloud, chosen)
    wanted = min(RESOLUTIONS, key=lambda r: abs(math.log(3.0 * r / spacing)))
    grid = cloud.region.grid(wanted, resolution)
    points, is_water = _thinned(cloud, chosen, grid.resolution)
    max_gap = min(max(GAP_SPACINGS * spacing, GAP_LIMITS[0]), GAP_LIMITS[1])
    distance, nearest = _nearest(points, grid)
    heights, quality = _triangulated(points, grid, distance, nearest, max_gap)
    surface = surface_by_slope(heights, quality, grid.resolution)
    water = is_water[nearest] & (distance <= max_gap)
    surface[water] = WATER_INDEX
    levelled = _level_still_water(heights, water, points[is_water], grid)
    quality[levelled & (quality == MISSING)] = INTERPOLATED
    return SurveyGround(cloud.reference, grid, heights, quality, surface)


def _nearest(points: np.ndarray, grid: SceneGrid) -> tuple[np.ndarray, np.ndarray]:
    """For each cell the distance in metres to the nearest point, and its index; (rows, cols)."""
    x, y = grid.xy()
    distance, nearest = KDTree(points[:, :2]).query(np.column_stack([x.ravel(), y.ravel()]))
    return np.reshape(distance, x.shape), np.reshape(nearest, x.shape)


def _triangulated(
    points: np.ndarray, grid: SceneGrid, distance: np.ndarray, nearest: np.ndarray, max_gap: float
) -> tuple[np.ndarray, np.ndarray]:
    """Heights and quality (rows, cols) from points (n, 3)."""
    places = np.column_stack([points[:, 1] + grid.half_height, points[:, 0] + grid.half_width])
    between = interpolate(
        places / grid.resolution, points[:, 2], distance.shape, 2.0 * max_gap / grid.resolution
    )
    known = np.isfinite(between) & (distance <= max_gap)
    quality = np.where(known, INTERPOLATED, MISSING).astype(np.uint8)
    row, col, inside = grid.cells(points[:, 0], points[:, 1])
    row, col = row[inside], col[inside]
    quality[row, col] = np.where(quality[row, col] == MISSING, MISSING, MEASURED)
    return np.where(known, between, points[nearest, 2]), quality


def ground_spacing(cloud: PointCloud, chosen: np.ndarray) -> float:
    """Mean spacing in metres of the chosen returns, as if they lay on a square lattice."""
    x, y = cloud.x[chosen], cloud.y[chosen]
    area = float(np.ptp(x) * np.ptp(y))
    if area <= 0.0:
        raise ScenarioError("its ground returns lie on one line")
    return math.sqrt(area / len(x))


def _thinned(cloud: PointCloud, chosen: np.ndarray, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """The mean point (n, 3) of each cell's chosen returns, and whether most of them are water."""
    x, y, z, wet = cloud.x[chosen], cloud.y[chosen], cloud.z[chosen], cloud.classes[chosen] == WATER
    cells = np.column_stack([np.rint(x / resolution), np.rint(y / resolution)]).astype(np.int64)
    cells -= cells.min(axis=0)
    _, group = np.unique(cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1], return_inverse=True)
    count = np.bincount(group)
    means = [np.bincount(group, values) / count for values in (x, y, z, wet.astype(float))]
    return np.column_stack(means[:3]), means[3] > 0.5


def _level_still_water(
    heights: np.ndarray, water: np.ndarray, points: np.ndarray, grid: SceneGrid
) -> np.ndarray:
    """Give each connected water whose returns agree within 0.6 m (10th to 90th percentile) their median;
    returns (rows, cols) bool where that was done."""
    levelled = np.zeros(water.shape, bool)
    bodies, count = connected(water)
    row, col, inside = grid.cells(points[:, 0], points[:, 1])
    owner = np.zeros(len(points), np.int64)
    owner[inside] = bodies[row[inside], col[inside]]
    for body in range(1, count + 1):
        levels = points[owner == body, 2]
        if len(levels) == 0:
            levels = heights[bodies == body]
        low, median, high = np.percentile(levels, [10, 50, 90])
        if high - low <= STILL_WATER_SPREAD:
            heights[bodies == body] = median
            levelled |= bodies == body
    return levelled
