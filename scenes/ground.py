"""The ground of a survey on the scene's grid: gaps filled, and how each height is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import ndimage
from scipy.spatial import Delaunay, QhullError

from scenes.georeference import Georeference, SceneGrid
from scenes.terrain import QUALITIES, SURFACES, Quality, Surface

MEASURED, INTERPOLATED, MISSING = (
    QUALITIES.index(q) for q in (Quality.MEASURED, Quality.INTERPOLATED, Quality.MISSING)
)
ROCK_SLOPE = math.radians(35.0)


@dataclass(frozen=True)
class SurveyGround:
    """heights : (rows, cols) metres above the survey's vertical datum, no NaN
    quality, surface : (rows, cols) uint8 indices into QUALITIES and SURFACES
    """

    reference: Georeference
    grid: SceneGrid
    heights: np.ndarray
    quality: np.ndarray
    surface: np.ndarray


def surface_by_slope(heights: np.ndarray, quality: np.ndarray, resolution: float) -> np.ndarray:
    """Grass, and bare rock where it is known to be too steep (over 35°) for soil; indices into SURFACES."""
    dy, dx = np.gradient(heights, resolution)
    doubtful = np.asarray(ndimage.binary_dilation(quality == MISSING, np.ones((3, 3), bool)), bool)
    steep = (np.hypot(dx, dy) > math.tan(ROCK_SLOPE)) & ~doubtful
    return np.where(steep, SURFACES.index(Surface.ROCK), SURFACES.index(Surface.GRASS)).astype(np.uint8)


def connected(cells: np.ndarray, corners: bool = True) -> tuple[np.ndarray, int]:
    """Number the patches of True cells that touch by a side (or a corner) from 1; 0 elsewhere."""
    patches = np.zeros(cells.shape, np.int32)
    neighbours = ndimage.generate_binary_structure(2, 2 if corners else 1)
    count = ndimage.label(cells, neighbours, output=patches)
    return patches, int(count)  # pyright: ignore[reportArgumentType]


def fill_gaps(heights: np.ndarray, resolution: float, max_gap: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights without NaN, and the index into QUALITIES of each cell.

    heights : (rows, cols) metres, NaN where nothing was measured; at least one is known
    max_gap : metres; gaps more than twice as wide are missing

    Other gaps are interpolated linearly between the known cells about them. Missing cells, and those
    outside what was measured, take the nearest known height so that the ground has no holes.
    """
    unknown = np.isnan(heights)
    quality = np.full(heights.shape, MEASURED, np.uint8)
    if not unknown.any():
        return heights.copy(), quality
    distance, nearest = ndimage.distance_transform_edt(  # pyright: ignore[reportGeneralTypeIssues]
        unknown, sampling=resolution, return_indices=True
    )
    filled = heights[tuple(nearest)]
    rim = ~unknown & ndimage.binary_dilation(unknown, np.ones((3, 3), bool))
    rim_cells = np.argwhere(rim).astype(float)
    between = interpolate(rim_cells, heights[rim], heights.shape, 2.0 * max_gap / resolution)
    bridged = unknown & np.isfinite(between) & (distance <= max_gap)
    quality[unknown] = MISSING
    quality[bridged] = INTERPOLATED
    return np.where(bridged, between, filled), quality


def interpolate(
    points: np.ndarray, heights: np.ndarray, shape: tuple[int, int], max_edge: float
) -> np.ndarray:
    """Heights (rows, cols) at whole cells on the Delaunay triangles of points with heights (n,).

    points : (n, 2) row and column, in fractions of cells; max_edge : cells

    NaN outside the convex hull, in triangles with a side longer than `max_edge` (they bridge a gap or lie
    along the rim of what was measured), and everywhere where the points span no triangle.
    """
    result = np.full(shape, np.nan)
    if len(points) < 3:
        return result
    try:
        triangles = Delaunay(points - points.mean(axis=0)).simplices
    except QhullError:
        return result
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    short = longest <= max_edge
    _draw_triangles(corners[short], heights[triangles[short]], result)
    return result


@njit(cache=True)
def _draw_triangles(corners: np.ndarray, heights: np.ndarray, result: np.ndarray) -> None:
    """Write the plane through each triangle's corners (n, 3, 2), heights (n, 3), to the cells in it."""
    rows, cols = result.shape
    for t in range(len(corners)):
        (r0, c0), (r1, c1), (r2, c2) = corners[t]
        area = (r1 - r0) * (c2 - c0) - (c1 - c0) * (r2 - r0)
        if abs(area) < 1e-12:
            continue
        for row in range(max(math.ceil(min(r0, r1, r2)), 0), min(math.floor(max(r0, r1, r2)), rows - 1) + 1):
            for col in range(
                max(math.ceil(min(c0, c1, c2)), 0), min(math.floor(max(c0, c1, c2)), cols - 1) + 1
            ):
                w1 = ((row - r0) * (c2 - c0) - (col - c0) * (r2 - r0)) / area
                w2 = ((r1 - r0) * (col - c0) - (c1 - c0) * (row - r0)) / area
                if w1 >= -1e-9 and w2 >= -1e-9 and w1 + w2 <= 1.0 + 1e-9:
                    h0, h1, h2 = heights[t]
                    result[row, col] = h0 + w1 * (h1 - h0) + w2 * (h2 - h0)
