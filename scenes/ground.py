"""The ground of a survey on the scene's grid: gaps filled, and how each height is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
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
    max_gap : metres to the nearest known cell beyond which a height counts as missing

    Gaps are interpolated linearly between the known cells about them. Cells outside what was measured, or
    too far inside a gap, are missing; they take the nearest known height so that the ground has no holes.
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
    gaps = np.argwhere(unknown)
    between = interpolate(np.argwhere(rim), heights[rim], gaps)
    known = np.isfinite(between) & (distance[unknown] <= max_gap)
    quality[unknown] = np.where(known, INTERPOLATED, MISSING)
    filled[unknown] = np.where(known, between, filled[unknown])
    return filled, quality


def interpolate(points: np.ndarray, heights: np.ndarray, queries: np.ndarray) -> np.ndarray:
    """Heights (m,) at queries (m, 2) on the Delaunay triangles of points (n, 2) with heights (n,);
    NaN outside their convex hull, and everywhere where they span no triangle."""
    if len(points) < 3:
        return np.full(len(queries), np.nan)
    try:
        triangles = Delaunay(points - points.mean(axis=0))
    except QhullError:
        return np.full(len(queries), np.nan)
    return LinearNDInterpolator(triangles, heights)(queries - points.mean(axis=0))
