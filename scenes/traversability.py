"""Where the Husky can go on the true map: slope, steps, water, missing data, cover and the map's edge."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy import ndimage

from scenes.catalogue import Footprint
from scenes.robot import HUSKY
from scenes.scenario import CoverSpec
from scenes.terrain import QUALITY_CODE, SURFACE_CODE, Heightmap, Quality, Surface

DRIVING_CLEARANCE = HUSKY.inscribed_radius + 0.05
ROBOT_SCALE = 0.25


def blocked_cells(
    heightmap: Heightmap, cover: Iterable[CoverSpec] = (), clearance: float = DRIVING_CLEARANCE
) -> np.ndarray:
    """(rows, cols) bool: cells where the robot's centre must not be.

    Slopes above the Husky's limit and steps higher than it climbs block where they are; water, missing
    data, cover footprints and the map's edge block `clearance` metres around, too.
    """
    return too_steep(heightmap) | near_hazard(heightmap, clearance) | near_cover(heightmap, cover, clearance)


def reachable(
    heightmap: Heightmap,
    cover: Iterable[CoverSpec],
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    clearance: float = DRIVING_CLEARANCE,
) -> bool:
    """Whether cells free with `clearance` connect start and goal, edge to edge."""
    regions, _ = ndimage.label(~blocked_cells(heightmap, cover, clearance))  # type: ignore[misc]
    start, goal = regions[heightmap.cell(*start_xy)], regions[heightmap.cell(*goal_xy)]
    return bool(start != 0 and start == goal)


def too_steep(heightmap: Heightmap) -> np.ndarray:
    """(rows, cols) bool: steeper than the Husky climbs, over half a metre, or a step between two cells."""
    heights, resolution = heightmap.heights, heightmap.resolution
    span = 2 * max(1, round(ROBOT_SCALE / resolution)) - 1
    smooth = ndimage.uniform_filter(heights, span, mode="nearest") if span > 1 else heights
    dy, dx = np.gradient(smooth, resolution)
    steep = np.hypot(dx, dy) > math.tan(HUSKY.max_slope)
    step = max(HUSKY.max_step, resolution * math.tan(HUSKY.max_slope))
    along_y = np.abs(np.diff(heights, axis=0)) > step
    along_x = np.abs(np.diff(heights, axis=1)) > step
    steep[:-1] |= along_y
    steep[1:] |= along_y
    steep[:, :-1] |= along_x
    steep[:, 1:] |= along_x
    return steep


def near_hazard(heightmap: Heightmap, clearance: float) -> np.ndarray:
    """(rows, cols) bool: within `clearance` of water, missing data or the map's edge."""
    hazard = (heightmap.surface == SURFACE_CODE[Surface.WATER]) | (
        heightmap.quality == QUALITY_CODE[Quality.MISSING]
    )
    border = math.ceil(clearance / heightmap.resolution)
    near = np.ones(hazard.shape, bool)
    near[border : -border or None, border : -border or None] = False
    if hazard.any():
        distance = ndimage.distance_transform_edt(~hazard, sampling=heightmap.resolution)
        near |= np.asarray(distance) < clearance
    return near


def near_cover(heightmap: Heightmap, cover: Iterable[CoverSpec], clearance: float) -> np.ndarray:
    """(rows, cols) bool: cells whose centre is nearer than `clearance` to what blocks on the ground."""
    near = np.zeros(heightmap.shape, bool)
    for thing in cover:
        mark_footprint(near, heightmap, thing.footprint, clearance)
    return near


def mark_footprint(cells: np.ndarray, heightmap: Heightmap, outline: Footprint, clearance: float) -> None:
    """Set the cells (rows, cols) whose centre is nearer than `clearance` to one outline."""
    reach = outline.radius + clearance
    low_row, low_col = heightmap.cell(outline.x - reach, outline.y - reach)
    high_row, high_col = heightmap.cell(outline.x + reach, outline.y + reach)
    x = heightmap.x_min + heightmap.resolution * np.arange(low_col, high_col + 1)
    y = heightmap.y_min + heightmap.resolution * np.arange(low_row, high_row + 1)
    grid_x, grid_y = np.meshgrid(x, y)
    distance = outline.distance(np.column_stack([grid_x.ravel(), grid_y.ravel()]))
    window = cells[low_row : high_row + 1, low_col : high_col + 1]
    window |= distance.reshape(window.shape) < clearance
