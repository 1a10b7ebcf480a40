"""The loops of `planner.map_sight`: what stands on a map, and how much light of each cell comes to an eye."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FIGURE = 0.6
"""Metres about an eye within which nothing hides: the observer itself is on the map there."""

DARK = 0.02
"""Share of light that counts as none."""

ROUNDING = 1e-6  # metres


@njit(cache=True, nogil=True)
def light_from(ground, stops, low, high, free, opacity, heights, rows, cols, eye, resolution, own):
    """(k, h) float32 share of light that reaches `eye` from `heights` (h,) over the ground of cells.

    ground : (r, c) heights without gaps; stops : (r, c) heights below which nothing is seen
    low, high : (r, c) heights between which something stops a share `opacity` (r, c) of the light, high <=
        low where nothing does; free : (r, c) of `free_above`
    heights : ascending; rows, cols : (k,) the cells asked for
    eye : (3,) column, row (not rounded, may lie off the map), height
    own : metres from the cell within which things do not hide, for the robot would stand there

    The line is looked at in every cell of its longer axis. The ground stops all light; a thing stops its
    share where the line enters it, so that one that covers many cells counts once.
    """
    count, levels = len(rows), len(heights)
    light = np.ones((count, levels), np.float32)
    map_rows, map_cols = ground.shape
    inside = np.zeros(levels, np.bool_)
    for i in range(count):
        row, col = rows[i], cols[i]
        step_col, step_row = eye[0] - col, eye[1] - row
        steps = max(abs(step_col), abs(step_row))
        if steps < 1.0:
            continue
        distance = math.hypot(step_col, step_row) * resolution
        first = max(1, int(own / distance * steps) + 1)
        last = int(steps * (1.0 - FIGURE / distance)) if distance > FIGURE else 0
        base = ground[row, col]
        inside[:] = False
        entered = False
        left = levels
        for k in range(1, last + 1):
            share = k / steps
            r, c = round(row + share * step_row), round(col + share * step_col)
            if r < 0 or c < 0 or r >= map_rows or c >= map_cols:
                break
            if base + heights[0] + share * (eye[2] - base - heights[0]) > free[r, c]:
                if entered:  # no level of `heights`, which ascend, meets anything here
                    inside[:] = False
                    entered = False
                continue
            floor, bottom, top = stops[r, c], low[r, c], high[r, c]
            for j in range(levels):
                if light[i, j] <= DARK:
                    continue
                z = base + heights[j] + share * (eye[2] - base - heights[j])
                if z < floor:
                    light[i, j] = 0.0
                elif k >= first and bottom <= z < top:
                    if not inside[j]:
                        light[i, j] *= 1.0 - opacity[r, c]
                    inside[j] = entered = True
                else:
                    inside[j] = False
                if light[i, j] <= DARK:
                    light[i, j] = 0.0
                    left -= 1
            if left == 0:
                break
    return light


@njit(cache=True, nogil=True)
def free_above(stops, low, high):
    """(r, c) heights above which nothing stops light, and a little more than rounding can take away."""
    rows, cols = stops.shape
    free = np.empty((rows, cols))
    for r in range(rows):
        for c in range(cols):
            top = high[r, c] if high[r, c] > low[r, c] else -np.inf
            free[r, c] = max(stops[r, c], top) + ROUNDING
    return free


@njit(cache=True)
def identify(low, high, blobs, count, things, resolution):
    """(r, c) share of light that is stopped between `low` and `high`, as far as the camera tells what stands
    there; all of it elsewhere. What it tells of heights and backs goes into `low` and `high`, in place.

    blobs : (r, c) from 1 to `count`, which of the connected things a cell belongs to, 0 for none
    things : (n, 6) metres from cell [0, 0] along columns and rows to the object's middle, from there to where
        returns are still its own, squared to where it must be solid, negative for what is hollow; height of
        its top, share of light that it stops

    The most frequent blob among an object's own cells is that object; all of it stops as little light as the
    most transparent object that it is.
    """
    rows, cols = blobs.shape
    of_blob, share = np.ones(count + 1), np.ones((rows, cols))
    for i in range(len(things)):
        x, y, own, solid, top, opacity = things[i]
        south, north = max(math.ceil((y - own) / resolution), 0), math.floor((y + own) / resolution) + 1
        west, east = max(math.ceil((x - own) / resolution), 0), math.floor((x + own) / resolution) + 1
        cells = np.zeros(count + 1, np.int64)
        for r in range(south, min(north, rows)):
            for c in range(west, min(east, cols)):
                away = (y - r * resolution) ** 2 + (x - c * resolution) ** 2
                if blobs[r, c] > 0 and away <= own * own:
                    # The beams end below the top of what is near and high; the camera has seen how high.
                    high[r, c] = max(high[r, c], top)
                    cells[blobs[r, c]] += 1
                if away <= solid:  # it stands where it must be, seen or not
                    if not high[r, c] > low[r, c]:
                        share[r, c], high[r, c] = opacity, top
                    high[r, c], low[r, c] = max(high[r, c], top), -np.inf
        whole = np.argmax(cells)
        if cells[whole] > 0:
            of_blob[whole] = min(of_blob[whole], opacity)
    for r in range(rows):
        for c in range(cols):
            if blobs[r, c] > 0:
                share[r, c] = of_blob[blobs[r, c]]
    return share
