"""Single trees, bushes and buildings from returns above the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy import ndimage

from scenes.catalogue import CATALOGUE, CoverKind
from scenes.ground import MISSING, SurveyGround, connected
from scenes.lidar_survey import BUILDING, UNCLASSIFIED, VEGETATION
from scenes.point_cloud import PointCloud
from scenes.scenario import CoverObject

LOWEST, TREE_HEIGHT, HIGHEST = 0.5, 2.0, 60.0
BUSH_WINDOW = 1.5
CROWN_EDGE = 0.5
MIN_BUILDING_AREA = 6.0
CANOPY_CELLS = (0.25, 1.0)


@dataclass(frozen=True)
class CanopyHeights:
    """Highest return above the ground per cell.

    heights : (rows, cols) metres, 0 where nothing stands
    x, y : (rows, cols) scene metres of that return
    """

    heights: np.ndarray
    x: np.ndarray
    y: np.ndarray
    resolution: float


@dataclass(frozen=True)
class Crown:
    """A plant in scene metres: place of its top, height above the ground, radius of its crown."""

    x: float
    y: float
    height: float
    radius: float


def standing_objects(cloud: PointCloud, ground: SurveyGround) -> list[CoverObject]:
    """Trees, bushes and buildings, tallest first, numbered from 1.

    Vegetation is class 3 to 5, or class 1 where the survey has none of those. Returns lower than 0.5 m
    above the ground, higher than 60 m, or over ground that is missing are left out, but for roofs: no laser
    reaches the ground beneath them, and they stand on the nearest that is known.
    """
    over_nearest, known = height_above_ground(cloud, ground)
    above = np.where(known, over_nearest, np.nan)
    plant = np.isin(cloud.classes, VEGETATION)
    if not plant.any():
        plant = cloud.classes == UNCLASSIFIED
    usable = (above >= LOWEST) & (above <= HIGHEST)
    pick = plant & usable
    found: list[dict] = []
    if pick.any():
        canopy = canopy_heights(cloud.x[pick], cloud.y[pick], above[pick], _canopy_cell(cloud, pick))
        found += [_tree(crown) for crown in crowns(canopy, TREE_HEIGHT)]
        found += [_bush(crown) for crown in bushes(canopy)]
    pick = (cloud.classes == BUILDING) & (over_nearest >= LOWEST) & (over_nearest <= HIGHEST)
    if pick.any():
        found += buildings(cloud.x[pick], cloud.y[pick], over_nearest[pick], known[pick])
    west, south = -ground.grid.half_width, -ground.grid.half_height
    found = [o for o in found if west <= o["x"] <= -west and south <= o["y"] <= -south]
    found.sort(key=lambda o: (-o["height"], o["x"], o["y"]))
    return [CoverObject(id=index, **fields) for index, fields in enumerate(found, start=1)]


def height_above_ground(cloud: PointCloud, ground: SurveyGround) -> tuple[np.ndarray, np.ndarray]:
    """Height (n,) of each return over the ground below it, or over the nearest known where that is missing;
    and (n,) bool, whether it is known there. Off the grid nothing is, and the height is NaN."""
    grid = ground.grid
    row, col, inside = grid.cells(cloud.x, cloud.y)
    places = np.array([(cloud.y + grid.half_height), (cloud.x + grid.half_width)]) / grid.resolution
    below = ndimage.map_coordinates(ground.heights, places, order=1, mode="nearest")
    known = inside.copy()
    known[inside] = ground.quality[row[inside], col[inside]] != MISSING
    return np.where(inside, cloud.z - below, np.nan), known


def _canopy_cell(cloud: PointCloud, pick: np.ndarray) -> float:
    """Cell size that holds about four plant returns where plants stand, so that few cells are empty."""
    square_metres = np.column_stack([np.rint(cloud.x[pick]), np.rint(cloud.y[pick])])
    area = len(np.unique(square_metres, axis=0))
    return min(max(math.sqrt(4.0 * area / int(pick.sum())), CANOPY_CELLS[0]), CANOPY_CELLS[1])


def canopy_heights(x: np.ndarray, y: np.ndarray, above: np.ndarray, resolution: float) -> CanopyHeights:
    """Grid returns (n,) by their highest; empty cells amid a canopy take their neighbours' median."""
    col, row = np.rint(x / resolution).astype(np.int64), np.rint(y / resolution).astype(np.int64)
    west, south = col.min() - 1, row.min() - 1
    col, row = col - west, row - south
    shape = (int(row.max()) + 2, int(col.max()) + 2)
    order = np.argsort(above, kind="stable")
    highest = np.full(shape, -1, np.int64)
    highest[row[order], col[order]] = order
    filled = highest >= 0
    heights = np.where(filled, above[highest], 0.0)
    hole = ~filled & (ndimage.uniform_filter(filled.astype(float), 3) > 4.5 / 9.0)
    heights[hole] = ndimage.median_filter(heights, 3)[hole]
    rows, cols = np.indices(shape)
    tops_x = np.where(filled, x[highest], (cols + west) * resolution)
    tops_y = np.where(filled, y[highest], (rows + south) * resolution)
    return CanopyHeights(heights, tops_x, tops_y, resolution)


def crown_window(height: np.ndarray) -> np.ndarray:
    """Radius in metres within which a tree of this height has no higher neighbour: half the crown width
    2.51503 + 0.00901 h² of Popescu and Wynne (2004), pines and deciduous trees together."""
    return 0.5 * (2.51503 + 0.00901 * np.square(height))


def crowns(canopy: CanopyHeights, lowest: float) -> list[Crown]:
    """Trees: local maxima within a window that grows with height, each with the watershed of the canopy
    about it down to half its height; the radius is that of a disc of the same area."""
    heights = canopy.heights
    reach = np.ceil(crown_window(heights) / canopy.resolution - 0.5).astype(int)
    tops = _local_maxima(heights, np.maximum(reach, 1), heights >= lowest)
    return _grown(canopy, tops, heights >= lowest)


def bushes(canopy: CanopyHeights) -> list[Crown]:
    """Low plants (0.5 to 2 m) that stand clear of any tree."""
    near_trees = ndimage.maximum_filter(canopy.heights, 3) >= TREE_HEIGHT
    low = (canopy.heights > 0.0) & ~near_trees
    lone = CanopyHeights(np.where(low, canopy.heights, 0.0), canopy.x, canopy.y, canopy.resolution)
    reach = np.full(low.shape, max(1, round(BUSH_WINDOW / canopy.resolution)))
    return _grown(lone, _local_maxima(lone.heights, reach, low), low)


def _local_maxima(heights: np.ndarray, reach: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Cells that nothing within `reach` cells tops; one cell of each plateau."""
    tops = np.zeros(heights.shape, bool)
    for radius in np.unique(reach[allowed]):
        offsets = np.arange(-radius, radius + 1)
        disc = np.hypot(*np.meshgrid(offsets, offsets)) <= radius + 0.25
        tops |= allowed & (reach == radius) & (heights == ndimage.maximum_filter(heights, footprint=disc))
    plateaus, count = connected(tops)
    first = np.full(count + 1, heights.size)
    np.minimum.at(first, plateaus.ravel(), np.arange(heights.size))
    single = np.zeros(heights.size, bool)
    single[first[1:]] = True
    return single.reshape(heights.shape)


def _grown(canopy: CanopyHeights, tops: np.ndarray, allowed: np.ndarray) -> list[Crown]:
    rows, cols = np.nonzero(tops)
    if len(rows) == 0:
        return []
    markers = np.zeros(tops.shape, np.int32)
    markers[rows, cols] = np.arange(1, len(rows) + 1)
    markers[~allowed] = -1
    depth = np.clip((HIGHEST + 1.0 - canopy.heights) * 1000.0, 0, 65535).astype(np.uint16)
    basins = ndimage.watershed_ift(depth, markers, np.ones((3, 3), int))
    peak = np.concatenate([[np.inf], canopy.heights[rows, cols]])
    owner = np.where(allowed & (basins > 0), basins, 0)
    owner[canopy.heights < CROWN_EDGE * peak[owner]] = 0
    area = np.bincount(owner.ravel(), minlength=len(rows) + 1)[1:] * canopy.resolution**2
    radius = np.sqrt(np.maximum(area, canopy.resolution**2) / math.pi)
    columns = (canopy.x[rows, cols], canopy.y[rows, cols], canopy.heights[rows, cols], radius)
    return [Crown(*(float(v) for v in values)) for values in zip(*columns, strict=True)]


def _tree(crown: Crown) -> dict:
    return _plant(CoverKind.TREE, crown)


def _bush(crown: Crown) -> dict:
    return _plant(CoverKind.BUSH, crown)


def _plant(kind: CoverKind, crown: Crown) -> dict:
    entry = CATALOGUE[kind]
    across = round(min(max(2.0 * crown.radius, entry.length.low), entry.length.high), 2)
    return {
        "kind": kind, "x": round(crown.x, 2), "y": round(crown.y, 2),
        "length": across, "width": across, "height": round(crown.height, 2),
    }  # fmt: skip


def buildings(x: np.ndarray, y: np.ndarray, above: np.ndarray, known: np.ndarray) -> list[dict]:
    """The smallest upright box about each cluster (1 m apart) of building returns of 6 m² or more.

    known : (n,) whether the ground below each is known; a cluster over none that is would float"""
    cell = 1.0
    col, row = np.rint(x / cell).astype(np.int64), np.rint(y / cell).astype(np.int64)
    col, row = col - col.min(), row - row.min()
    filled = np.zeros((int(row.max()) + 1, int(col.max()) + 1), bool)
    filled[row, col] = True
    closed = ndimage.binary_closing(np.pad(filled, 2), np.ones((3, 3), bool))[2:-2, 2:-2] | filled
    clusters, count = connected(closed)
    owner = clusters[row, col]
    found = []
    for cluster in range(1, count + 1):
        chosen = owner == cluster
        large = (clusters == cluster).sum() * cell**2 >= MIN_BUILDING_AREA and chosen.sum() >= 4
        if large and known[chosen].any():
            box = _box(np.column_stack([x[chosen], y[chosen]]), float(np.percentile(above[chosen], 95)))
            found.extend([box] if box else [])
    return found


def _box(points: np.ndarray, height: float) -> dict | None:
    try:
        to_box, sides = trimesh.bounds.oriented_bounds_2D(points)
    except (ValueError, RuntimeError):
        return None  # the returns lie on one line
    to_world = np.linalg.inv(to_box)
    yaw = math.degrees(math.atan2(to_world[1, 0], to_world[0, 0]))
    length, width = (min(max(float(side), 1.0), HIGHEST) for side in sides)
    return {
        "kind": CoverKind.BUILDING, "yaw": round(yaw, 1),
        "x": round(float(to_world[0, 2]), 2), "y": round(float(to_world[1, 2]), 2),
        "length": round(length, 2), "width": round(width, 2), "height": round(height, 2),
    }  # fmt: skip
