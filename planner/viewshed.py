"""Exact viewsheds on a height grid: which cells an observer sees over bare ground.

The definition: the straight line from the eye to the target point over a cell's centre is tested wherever it
crosses a row line or a column line of samples strictly between the two cells; terrain there is interpolated
linearly between the two neighbouring samples of that line; higher than the sight line (beyond 1e-9) hides,
touching does not. The target height is added at the tested cell alone; no curvature; the observer's own cell
is visible (W. R. Franklin's R3). Lengths cancel out: only heights have a unit, the grid's own.
"""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from planner.viewshed_kernel import COARSE, TILE, tile_maxima, viewshed_rows


def viewshed(
    heights: np.ndarray, row: int, column: int, eye_height: float, target_height: float = 0.0
) -> np.ndarray:
    """Which cells are seen from one place.

    heights : (rows, cols) float, finite
    row, column : the observer's cell
    eye_height : of the eye above the ground of its cell; target_height : of what is looked for, above the
        ground of its own cell; both at least 0, in the unit of `heights`

    Returns (rows, cols) bool. Raises ValueError for heights that are not a finite grid, for a place outside
    it and for heights below the ground.
    """
    return viewsheds(heights, [(row, column, eye_height)], target_height)[0]


def viewsheds(
    heights: np.ndarray, observers: Sequence[tuple[int, int, float]], target_height: float = 0.0
) -> np.ndarray:
    """Which cells each of several observers sees, as `viewshed`, in parallel.

    observers : row, column and eye height of each

    Returns (n, rows, cols) bool.
    """
    ground = _grid(heights)
    target = _above_ground("target height", target_height)
    places = [(*_cell(ground.shape, r, c), _above_ground("eye height", eye)) for r, c, eye in observers]
    turned = np.ascontiguousarray(ground.T)
    fine, coarse = tile_maxima(ground, TILE), tile_maxima(ground, COARSE)

    def seen(place: tuple[int, int, float]) -> np.ndarray:
        row, column, eye_height = place
        eye = ground[row, column] + eye_height
        return viewshed_rows(ground, turned, fine, coarse, row, column, eye, target)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.array(list(pool.map(seen, places)), bool).reshape(len(places), *ground.shape)


def _grid(heights: np.ndarray) -> np.ndarray:
    ground = np.ascontiguousarray(heights, np.float64)
    if ground.ndim != 2 or ground.size == 0:
        raise ValueError(f"heights must be a grid of rows and columns, not of shape {ground.shape}")
    bad = np.argwhere(~np.isfinite(ground))
    if len(bad):
        raise ValueError(
            f"{len(bad)} of the heights are not finite, the first at row {bad[0][0]}, column {bad[0][1]}: "
            "what cannot be known to hide must be filled in or left out before"
        )
    return ground


def _cell(shape: tuple[int, ...], row: int, column: int) -> tuple[int, int]:
    try:
        row, column = operator.index(row), operator.index(column)
    except TypeError:
        raise ValueError(f"row and column must be whole numbers, not {row!r} and {column!r}") from None
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ValueError(
            f"the observer's cell (row {row}, column {column}) is outside the grid of "
            f"{shape[0]} rows and {shape[1]} columns"
        )
    return row, column


def _above_ground(name: str, height: float) -> float:
    if not (math.isfinite(height) and height >= 0.0):
        raise ValueError(f"the {name} must be at least 0, not {height}")
    return float(height)
