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

    A cell that holds a ground (or water) return is measured. One between returns is interpolated; outside
    their hull, or farther from the nearest than 2.5 times their mean spacing (3 to 8 m), it is missing and
    takes the nearest height. Water is where the nearest return is water; still water is levelled.
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
    wet = cloud.classes == WATER
    spacing = ground_spacing(cloud, on_ground | wet)
    wanted = min(RESOLUTIONS, key=lambda r: abs(math.log(3.0 * r / spacing)))
    grid = cloud.region.grid(wanted, resolution)
    points, is_water = _thinned(cloud, on_ground | wet, grid.resolution)
    x, y = grid.xy()
    queries = np.column_stack([x.ravel(), y.ravel()])
    tree = KDTree(points[:, :2])
    distance, nearest = tree.query(queries)
    between = interpolate(points[:, :2], points[:, 2], queries)
    max_gap = min(max(GAP_SPACINGS * spacing, GAP_LIMITS[0]), GAP_LIMITS[1])
    known = np.isfinite(between) & (distance <= max_gap)
    heights = np.where(known, between, points[nearest, 2]).reshape(x.shape)
    quality = np.where(known, INTERPOLATED, MISSING).astype(np.uint8).reshape(x.shape)
    row, col, inside = grid.cells(points[:, 0], points[:, 1])
    held = quality[row[inside], col[inside]]
    quality[row[inside], col[inside]] = np.where(held == MISSING, MISSING, MEASURED)
    surface = surface_by_slope(heights, quality, grid.resolution)
    water = (is_water[nearest] & known).reshape(x.shape)
    surface[water] = WATER_INDEX
    _level_still_water(heights, water, points[is_water], grid)
    return SurveyGround(cloud.reference, grid, heights, quality, surface)


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
) -> None:
    """Give each connected water whose returns agree within 0.6 m (10th to 90th percentile) their median."""
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
