"""The loops of the elevation map: fuse a scan and read the grid out.

`cells` is (len(EMPTY), rows, cols) float64, a plane for each of the names below; a cell holds one number of
each:

MEAN, SPREAD, WEIGHT      ground height: weighted mean, weighted sum of squared deviations, sum of weights
LOWEST, HIGHEST           lowest and highest return from the ground
FOOT, TOP, BELOW          lowest and highest return from what stands there, and the ground expected under it
EVIDENCE, GAINED, TURN    how surely it stands there, what the newest scan added, and which scan that was
HANG                      lowest return from what hangs higher than the robot
WATER                     returns from water less returns from dry ground, between -MAX_WET and MAX_WET
PEAK                      highest return from what stands or hangs there
"""

from __future__ import annotations

import math

import numba
import numpy as np

from planner.ground_segmentation import GROUND, STANDING

MEAN, SPREAD, WEIGHT, LOWEST, HIGHEST, FOOT, TOP, BELOW, EVIDENCE, GAINED, TURN, HANG, WATER, PEAK = range(14)
EMPTY = np.array([0.0, 0.0, 0.0, np.nan, np.nan, np.inf, -np.inf, 0.0, 0.0, 0.0, -1.0, np.inf, 0.0, -np.inf])

GATE = 0.3  # metres: ground this far from what a cell holds is not the same surface
SIGMA_PER_METRE = 0.003  # what pointing adds to a height's standard deviation
MAX_WEIGHT = 50.0 / 0.03**2  # old measurements count as fifty at most, so that a cell follows change
MAX_GAIN, MAX_EVIDENCE = 4.0, 20.0  # one for a return, four for a scan at most
BLOCKS = 2.0  # evidence from which on something blocks
MAX_WET = 10.0
NEIGHBOURHOOD = 5  # cells: how far the ground below a standing thing may be looked for
FILL_SLOPE = 0.1  # what the ground may do inside a filled gap, as a standard deviation


def empty_cells(rows: int, cols: int) -> np.ndarray:
    """Cells that nothing is known of."""
    cells = np.empty((len(EMPTY), rows, cols))
    cells[:] = EMPTY[:, None, None]
    return cells


@numba.njit(cache=True)
def fuse(
    cells, points, labels, expected, distance, wet, x_min, y_min, resolution, range_sigma, clearance, turn
):
    """Add the labelled returns of one scan to `cells`, in place.

    distance : (columns, beams) metres of each return from the sensor, over the ground
    wet : (columns, beams) bool, or (0, 0) where nothing tells water from dry ground; turn : counts scans
    """
    columns, beams, _ = points.shape
    _, rows, cols = cells.shape
    for c in range(columns):
        for i in range(beams):
            label = labels[c, i]
            if label != GROUND and label != STANDING:
                continue
            x, y, z = points[c, i, 0], points[c, i, 1], points[c, i, 2]
            row = int(np.rint((y - y_min) / resolution))
            col = int(np.rint((x - x_min) / resolution))
            if row < 0 or row >= rows or col < 0 or col >= cols:
                continue
            cell = cells[:, row, col]
            below = cell[MEAN] if cell[WEIGHT] > 0.0 else expected[c, i]
            if label == GROUND and (cell[WEIGHT] == 0.0 or z - cell[MEAN] <= GATE):
                sigma = range_sigma + SIGMA_PER_METRE * distance[c, i]
                add_ground(cell, z, 1.0 / (sigma * sigma))
                if wet.size > 0:
                    cell[WATER] += 1.0 if wet[c, i] else -1.0
                    cell[WATER] = min(max(cell[WATER], -MAX_WET), MAX_WET)
            elif z - below >= clearance:
                cell[HANG] = min(cell[HANG], z)
                cell[PEAK] = max(cell[PEAK], z)
            else:
                _add_standing(cell, z, below, turn)


@numba.njit(cache=True)
def add_ground(cell, z, weight):
    """Fuse one ground height into a cell: weighted running mean and spread (West 1979)."""
    if cell[WEIGHT] == 0.0 or cell[MEAN] - z > GATE:
        # Nothing known yet, or what was taken for ground was something above it.
        cell[MEAN], cell[SPREAD], cell[WEIGHT], cell[LOWEST], cell[HIGHEST] = z, 0.0, weight, z, z
        return
    total = cell[WEIGHT] + weight
    offset = z - cell[MEAN]
    cell[MEAN] += offset * weight / total
    cell[SPREAD] += weight * offset * (z - cell[MEAN])
    cell[WEIGHT] = total
    if total > MAX_WEIGHT:
        cell[SPREAD] *= MAX_WEIGHT / total
        cell[WEIGHT] = MAX_WEIGHT
    cell[LOWEST] = min(cell[LOWEST], z)
    cell[HIGHEST] = max(cell[HIGHEST], z)


@numba.njit(cache=True)
def stand(cells, place, heading, up, half_size, x_min, y_min, resolution, weight):
    """The robot's base rests on the ground at `place` (3,): the ground under its outline is known as well as
    `weight` says, and nothing else is there.

    heading : (2,) cosine and sine of its yaw; up : (3,) its up axis in the world; half_size : (2,) metres
    """
    _, rows, cols = cells.shape
    reach = math.ceil(math.hypot(half_size[0], half_size[1]) / resolution)
    middle_row = int(np.rint((place[1] - y_min) / resolution))
    middle_col = int(np.rint((place[0] - x_min) / resolution))
    for row in range(max(middle_row - reach, 0), min(middle_row + reach + 1, rows)):
        for col in range(max(middle_col - reach, 0), min(middle_col + reach + 1, cols)):
            dx, dy = x_min + col * resolution - place[0], y_min + row * resolution - place[1]
            along, across = heading[0] * dx + heading[1] * dy, heading[0] * dy - heading[1] * dx
            if abs(along) <= half_size[0] and abs(across) <= half_size[1]:
                add_ground(cells[:, row, col], place[2] - (up[0] * dx + up[1] * dy) / up[2], weight)
                cells[EVIDENCE, row, col] = 0.0


@numba.njit(cache=True)
def _add_standing(cell, z, below, turn):
    if cell[EVIDENCE] == 0.0:
        cell[FOOT], cell[TOP] = z, z
        cell[PEAK] = z if cell[HANG] == np.inf else cell[PEAK]
    cell[FOOT] = min(cell[FOOT], z)
    cell[TOP] = max(cell[TOP], z)
    cell[PEAK] = max(cell[PEAK], z)
    cell[BELOW] = below
    if cell[TURN] != turn:
        cell[TURN], cell[GAINED] = turn, 0.0
    if cell[GAINED] < MAX_GAIN:
        cell[GAINED] += 1.0
        cell[EVIDENCE] = min(cell[EVIDENCE] + 1.0, MAX_EVIDENCE)


@numba.njit(cache=True)
def measured_ground(cells):
    """(rows, cols) ground height and its variance: the spread of what was measured and the uncertainty of
    its mean; NaN where nothing was."""
    _, rows, cols = cells.shape
    height, variance = np.empty((rows, cols)), np.empty((rows, cols))
    for row in range(rows):
        for col in range(cols):
            weight = cells[WEIGHT, row, col]
            known = weight > 0.0
            height[row, col] = cells[MEAN, row, col] if known else np.nan
            variance[row, col] = (cells[SPREAD, row, col] + 1.0) / weight if known else np.nan
    return height, variance


@numba.njit(cache=True)
def fill_gaps(elevation, variance, resolution, max_gap):
    """Interpolate gaps of up to `max_gap` unknown cells (NaN) between known ones, along rows and columns.

    Returns a new (elevation, variance). A filled cell is the mean of the two directions, weighted by
    1 / gap length; its variance is that of its ends plus what the ground may do inside the gap.
    """
    rows, cols = elevation.shape
    filled, spread = elevation.copy(), variance.copy()
    north = _to_known_northward(elevation, max_gap + 1)
    south, east = np.full(cols, max_gap + 1), np.empty(cols, np.int64)
    for row in range(rows):
        nearest = max_gap + 1
        for col in range(cols - 1, -1, -1):
            east[col] = nearest
            nearest = 1 if not np.isnan(elevation[row, col]) else nearest + 1
        west = max_gap + 1
        for col in range(cols):
            if not np.isnan(elevation[row, col]):
                west = south[col] = 1
                continue
            total = height = doubt = 0.0
            for dr, dc, ahead, behind in ((0, 1, east[col], west), (1, 0, north[row, col], south[col])):
                length = ahead + behind
                if length > max_gap + 1:
                    continue
                share = ahead / length
                r0, c0, r1, c1 = row + dr * ahead, col + dc * ahead, row - dr * behind, col - dc * behind
                weight = 1.0 / length
                total += weight
                height += weight * ((1.0 - share) * elevation[r0, c0] + share * elevation[r1, c1])
                ends = (1.0 - share) * variance[r0, c0] + share * variance[r1, c1]
                doubt += weight * (ends + (FILL_SLOPE * resolution * length) ** 2)
            if total > 0.0:
                filled[row, col], spread[row, col] = height / total, doubt / total
            west += 1
            south[col] += 1
    return filled, spread


@numba.njit(cache=True)
def _to_known_northward(elevation, most):
    """(rows, cols) steps to the next known cell up the column; `most` or more where there is none nearer."""
    rows, cols = elevation.shape
    steps_up = np.full((rows, cols), most)
    for row in range(rows - 2, -1, -1):
        for col in range(cols):
            known = not np.isnan(elevation[row + 1, col])
            steps_up[row, col] = 1 if known else steps_up[row + 1, col] + 1
    return steps_up


@numba.njit(cache=True)
def standing_things(cells, elevation, clearance, step):
    """What stands and what hangs over the ground `elevation` (rows, cols; NaN unknown).

    Returns (rows, cols) bool, where something higher than `step` reaches lower than `clearance` or where
    there is water, (rows, cols) float32 the clearance under what hangs there, inf where nothing does, and
    (2, rows, cols) float32 the heights between which something was seen to hang, or to stand where it
    reaches lower than `clearance`: inf and -inf where nothing was.
    """
    rows, cols = elevation.shape
    blocked, span = np.zeros((rows, cols), np.bool_), np.empty((2, rows, cols), np.float32)
    span[0], span[1] = np.inf, -np.inf
    overhang = np.full((rows, cols), np.float32(np.inf))
    for row in range(rows):
        for col in range(cols):
            blocked[row, col] = cells[WATER, row, col] > 0.0
            stands = cells[EVIDENCE, row, col] >= BLOCKS
            hang = cells[HANG, row, col]
            if not stands and hang == np.inf:
                continue
            ground = _nearest_ground(elevation, row, col) if stands else elevation[row, col]
            if np.isnan(ground):
                ground = cells[BELOW, row, col] if stands else hang - clearance
            if stands and cells[TOP, row, col] - ground > step:
                if cells[FOOT, row, col] - ground >= clearance:
                    hang = min(hang, cells[FOOT, row, col])
                else:
                    blocked[row, col] = True
            overhang[row, col] = max(hang - ground, 0.0)
            span[0, row, col] = cells[FOOT, row, col] if stands else hang
            span[1, row, col] = cells[PEAK, row, col]
    return blocked, overhang, span


@numba.njit(cache=True)
def _nearest_ground(elevation, row, col):
    """Known height nearest to a cell, the first in row order among equally near ones; NaN if none is near."""
    rows, cols = elevation.shape
    best, best_row, best_col = (NEIGHBOURHOOD + 1) ** 2 * 2, -1, -1
    for ring in range(NEIGHBOURHOOD + 1):
        if ring * ring > best:
            break
        for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
            stride = 1 if abs(r - row) == ring else max(2 * ring, 1)
            for c in range(col - ring, col + ring + 1, stride):
                if c < 0 or c >= cols or np.isnan(elevation[r, c]):
                    continue
                distance = (r - row) ** 2 + (c - col) ** 2
                if distance < best or (distance == best and (r, c) < (best_row, best_col)):
                    best, best_row, best_col = distance, r, c
    return np.nan if best_row < 0 else elevation[best_row, best_col]


@numba.njit(cache=True)
def steps(elevation, step, slope_rise):
    """(rows, cols) bool: the higher cell wherever the ground rises by more than `step` beyond what a
    drivable slope explains (`slope_rise` metres a cell), from a neighbour one or two cells away."""
    rows, cols = elevation.shape
    high = np.zeros((rows, cols), np.bool_)
    for apart in (1, 2):
        limit = step + slope_rise * apart
        for row in range(rows):
            for col in range(cols):
                height = elevation[row, col]
                higher = col >= apart and height - elevation[row, col - apart] > limit
                higher |= col < cols - apart and height - elevation[row, col + apart] > limit
                higher |= row >= apart and height - elevation[row - apart, col] > limit
                higher |= row < rows - apart and height - elevation[row + apart, col] > limit
                high[row, col] |= higher
    return high


@numba.njit(cache=True)
def turned_patch(elevation, x_min, y_min, resolution, x, y, yaw, size, spacing):
    """(size, size) heights of the cells nearest to points `spacing` apart about (x, y), axis 1 along `yaw`,
    axis 0 to its left; NaN off the map. elevation : (rows, cols), cell [0, 0] at (x_min, y_min)"""
    rows, cols = elevation.shape
    cos, sin = math.cos(yaw), math.sin(yaw)
    patch = np.full((size, size), np.nan, elevation.dtype)
    for i in range(size):
        left = (i - 0.5 * (size - 1)) * spacing
        for j in range(size):
            forward = (j - 0.5 * (size - 1)) * spacing
            col = int(np.rint((x + cos * forward - sin * left - x_min) / resolution))
            row = int(np.rint((y + sin * forward + cos * left - y_min) / resolution))
            if 0 <= row < rows and 0 <= col < cols:
                patch[i, j] = elevation[row, col]
    return patch
