"""Exact viewsheds on a height grid, compiled.

Each cell's sight line is tested at every crossing with a line of samples (Franklin's R3), so the result is
the definition's to the last cell. Two observations make that fast without changing it: what hid the
neighbouring cell usually hides this one, so that crossing is tested first; and where the highest ground of
a block of tiles lies below the sight line, none of the crossings in it can hide anything.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TOLERANCE = 1e-9
TILE = 8
COARSE = 64


@njit(cache=True)
def tile_maxima(heights: np.ndarray, tile: int) -> np.ndarray:
    """Highest sample of each tile, its far border included."""
    rows, cols = heights.shape
    out = np.full(((rows - 1) // tile + 1, (cols - 1) // tile + 1), -np.inf)
    for row in range(rows):
        for col in range(cols):
            h = heights[row, col]
            a, b = row // tile, col // tile
            if h > out[a, b]:
                out[a, b] = h
            if row % tile == 0 and a > 0 and h > out[a - 1, b]:
                out[a - 1, b] = h
            if col % tile == 0 and b > 0 and h > out[a, b - 1]:
                out[a, b - 1] = h
            if row % tile == 0 and col % tile == 0 and a > 0 and b > 0 and h > out[a - 1, b - 1]:
                out[a - 1, b - 1] = h
    return out


@njit(cache=True, inline="always")
def _hides(lines, along, across, step, d_across, k, eye, rise, count):
    """Whether the ground at crossing k of `count` line steps stands above the sight line.

    lines : heights with the crossed lines as rows; along, across : the observer's line and place on it"""
    line = along + step * k
    place = across + (d_across * k) / count  # in this order it is exact on samples
    near = int(np.floor(place))
    share = place - near
    ground = lines[line, near]
    if share > 0.0:
        ground += share * (lines[line, near + 1] - ground)
    return ground > eye + rise * (k / count) + TOLERANCE


@njit(cache=True, inline="always")
def _clear_block(maxima, tile, r0, r1, c0, c1, low):
    """Whether the highest ground of every tile that a box of samples touches is below `low`."""
    for a in range(r0 // tile, r1 // tile + 1):
        for b in range(c0 // tile, c1 // tile + 1):
            if maxima[a, b] > low:
                return False
    return True


@njit(cache=True)
def _blocking_crossing(lines, fine, coarse, along, across, d_along, d_across, eye, rise):
    """The first crossing (counted from the target) that hides the target, 0 where none does."""
    count = abs(d_along)
    if count < 2:
        return 0
    step = 1 if d_along > 0 else -1
    last_row = lines.shape[0] - 1
    last_col = lines.shape[1] - 1
    k = count - 1
    while k >= 1:
        for tile, maxima in ((COARSE, coarse), (TILE, fine)):
            end = max(k - tile + 1, 1)
            z0, z1 = eye + rise * (k / count), eye + rise * (end / count)
            p0, p1 = across + (d_across * k) / count, across + (d_across * end) / count
            l0, l1 = along + step * k, along + step * end
            c0 = max(int(np.floor(min(p0, p1))), 0)
            c1 = min(int(np.floor(max(p0, p1))) + 1, last_col)
            # a tile's far border counts as its own, so the last line and place may be left to it
            r0, r1 = min(l0, l1), min(max(l0, l1), last_row)
            if _clear_block(maxima, tile, r0, r1, c0, c1, min(z0, z1)):
                k = end - 1
                break
            if tile == TILE:
                while k >= end:
                    if _hides(lines, along, across, step, d_across, k, eye, rise, count):
                        return k
                    k -= 1
    return 0


@njit(cache=True)
def _row_of_cells(heights, turned, fine, coarse, fine_t, coarse_t, row, column, eye, target, i, out):
    """Visibility of one row of cells."""
    by_row = by_col = 0
    for j in range(heights.shape[1]):
        dr, dc = i - row, j - column
        if dr == 0 and dc == 0:
            out[i, j] = True
            continue
        rise = heights[i, j] + target - eye
        rows, cols = abs(dr), abs(dc)
        if 0 < by_row < rows:
            if _hides(heights, row, column, 1 if dr > 0 else -1, dc, by_row, eye, rise, rows):
                continue
        if 0 < by_col < cols:
            if _hides(turned, column, row, 1 if dc > 0 else -1, dr, by_col, eye, rise, cols):
                continue
        by_row = _blocking_crossing(heights, fine, coarse, row, column, dr, dc, eye, rise)
        if by_row:
            continue
        by_col = _blocking_crossing(turned, fine_t, coarse_t, column, row, dc, dr, eye, rise)
        if by_col == 0:
            out[i, j] = True


@njit(cache=True, nogil=True)
def viewshed_rows(heights, turned, fine, coarse, row, column, eye, target):
    """One viewshed, `turned` is the transposed grid, contiguous."""
    out = np.zeros(heights.shape, np.bool_)
    fine_t, coarse_t = fine.T.copy(), coarse.T.copy()
    for i in range(heights.shape[0]):
        _row_of_cells(heights, turned, fine, coarse, fine_t, coarse_t, row, column, eye, target, i, out)
    return out
