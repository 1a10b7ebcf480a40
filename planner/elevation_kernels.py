"""The loops of the elevation map: fuse a scan, clear what it sees through, read the grid out.

`cells` is (rows, cols, len(EMPTY)) float64; a cell holds one number for each of the names below:

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
MAX_GAIN, SEEN_THROUGH, MAX_EVIDENCE = 4.0, 2.0, 20.0  # one for a return, four for a scan at most
BLOCKS = 2.0  # evidence from which on something blocks
MAX_WET = 10.0
PASSED_BELOW = 0.15  # metres: more than a steep slope does within half a cell
GROUND_TURNS = 5
NEIGHBOURHOOD = 5  # cells: how far the ground below a standing thing may be looked for
FILL_SLOPE = 0.1  # what the ground may do inside a filled gap, as a standard deviation


@numba.njit(cache=True)
def fuse(
    cells, points, labels, expected, wet, origin, x_min, y_min, resolution, range_sigma, clearance, turn
):
    """Add the labelled returns of one scan to `cells`, in place.

    wet : (columns, beams) bool, or (0, 0) where nothing tells water from dry ground; turn : counts scans
    """
    columns, beams, _ = points.shape
    rows, cols, _ = cells.shape
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
            cell = cells[row, col]
            below = cell[MEAN] if cell[WEIGHT] > 0.0 else expected[c, i]
            if label == GROUND and (cell[WEIGHT] == 0.0 or z - cell[MEAN] <= GATE):
                sigma = range_sigma + SIGMA_PER_METRE * math.hypot(x - origin[0], y - origin[1])
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
def clear_seen_through(
    cells, points, labels, elevations, origin, rotation, x_min, y_min, resolution, turn
):
    """Take from cells what the newest lidar turn looked through, in place.

    A beam looks through a cell when it passes the cell's middle at a height where something was seen to
    stand and returns from farther away, or from the ground right behind. A beam that does not return says
    nothing, and one return from the cell that is not from the ground says that something is still there.
    Ground is forgotten where a beam passed `PASSED_BELOW` under it; each turn asks that of every
    `GROUND_TURNS`th row.
    elevations : (beams,) radians; origin (3,) and rotation (3, 3) of the sensor in the world
    """
    rows, cols, _ = cells.shape
    reach = np.hypot(points[:, :, 0] - origin[0], points[:, :, 1] - origin[1])
    for row in range(rows):
        asked = (row + int(turn)) % GROUND_TURNS == 0
        for col in range(cols):
            cell = cells[row, col]
            judged = cell[EVIDENCE] > 0.0 and cell[TURN] != turn
            if not judged and (cell[WEIGHT] == 0.0 or not asked):
                continue
            east = x_min + col * resolution - origin[0]
            north = y_min + row * resolution - origin[1]
            if math.hypot(east, north) < resolution:
                continue
            if judged:
                low, high = cell[FOOT] - 0.05 - origin[2], cell[TOP] + 0.05 - origin[2]
                seen, past = _look(reach, labels, elevations, rotation, east, north, low, high, resolution)
                if seen:
                    cell[TURN] = turn
                elif past:
                    cell[EVIDENCE] = max(cell[EVIDENCE] - SEEN_THROUGH, 0.0)
            if asked and cell[WEIGHT] > 0.0:
                high = cell[MEAN] - PASSED_BELOW - origin[2]
                _, past = _look(reach, labels, elevations, rotation, east, north, -np.inf, high, resolution)
                if past:
                    cell[WEIGHT] = 0.0
                    cell[LOWEST] = cell[HIGHEST] = np.nan


@numba.njit(cache=True)
def _look(reach, labels, elevations, rotation, east, north, low, high, resolution):
    """What the beams show that pass the middle of the cell at (east, north) from the sensor, between `low`
    and `high` over it: whether one returned from the cell, not from the ground, and whether one went past."""
    distance = math.hypot(east, north)
    step = 2.0 * math.pi / reach.shape[0]
    azimuth, highest = _direction(east, north, high, rotation)
    lowest = -np.inf if low == -np.inf else _direction(east, north, low, rotation)[1]
    middle, aside = int(np.rint(azimuth / step)), int(0.25 * resolution / distance / step)
    seen = past = False
    for i in range(len(elevations)):
        if elevations[i] < lowest or elevations[i] > highest:
            continue
        for c in range(middle - aside, middle + aside + 1):
            column = c % reach.shape[0]
            beyond = reach[column, i] - distance
            if abs(beyond) <= resolution and labels[column, i] != GROUND:
                seen = True
            elif beyond > 0.0:
                past = True
    return seen, past


@numba.njit(cache=True)
def _direction(east, north, up, rotation):
    """Azimuth and elevation in the sensor frame of an offset in the world."""
    x = rotation[0, 0] * east + rotation[1, 0] * north + rotation[2, 0] * up
    y = rotation[0, 1] * east + rotation[1, 1] * north + rotation[2, 1] * up
    z = rotation[0, 2] * east + rotation[1, 2] * north + rotation[2, 2] * up
    return math.atan2(y, x), math.atan2(z, math.hypot(x, y))


@numba.njit(cache=True)
def measured_ground(cells):
    """(rows, cols) ground height and its variance: the spread of what was measured and the uncertainty of
    its mean; NaN where nothing was."""
    rows, cols, _ = cells.shape
    height, variance = np.full((rows, cols), np.nan), np.full((rows, cols), np.nan)
    for row in range(rows):
        for col in range(cols):
            weight = cells[row, col, WEIGHT]
            if weight > 0.0:
                height[row, col] = cells[row, col, MEAN]
                variance[row, col] = (cells[row, col, SPREAD] + 1.0) / weight
    return height, variance


@numba.njit(cache=True)
def fill_gaps(elevation, variance, resolution, max_gap):
    """Interpolate gaps of up to `max_gap` unknown cells (NaN) between known ones, along rows and columns.

    Returns a new (elevation, variance). A filled cell is the mean of the two directions, weighted by
    1 / gap length; its variance is that of its ends plus what the ground may do inside the gap.
    """
    rows, cols = elevation.shape
    filled, spread = elevation.copy(), variance.copy()
    for row in range(rows):
        for col in range(cols):
            if not np.isnan(elevation[row, col]):
                continue
            total = height = doubt = 0.0
            for dr, dc in ((0, 1), (1, 0)):
                ahead = _to_known(elevation, row, col, dr, dc, max_gap)
                behind = _to_known(elevation, row, col, -dr, -dc, max_gap + 1 - ahead) if ahead else 0
                if not behind:
                    continue
                length = ahead + behind
                share = ahead / length
                r0, c0, r1, c1 = row + dr * ahead, col + dc * ahead, row - dr * behind, col - dc * behind
                weight = 1.0 / length
                total += weight
                height += weight * ((1.0 - share) * elevation[r0, c0] + share * elevation[r1, c1])
                ends = (1.0 - share) * variance[r0, c0] + share * variance[r1, c1]
                doubt += weight * (ends + (FILL_SLOPE * resolution * length) ** 2)
            if total > 0.0:
                filled[row, col], spread[row, col] = height / total, doubt / total
    return filled, spread


@numba.njit(cache=True)
def _to_known(elevation, row, col, dr, dc, reach):
    """Steps to the nearest known cell in one direction; 0 where there is none within `reach`."""
    rows, cols = elevation.shape
    for k in range(1, reach + 1):
        r, c = row + dr * k, col + dc * k
        if r < 0 or c < 0 or r >= rows or c >= cols:
            return 0
        if not np.isnan(elevation[r, c]):
            return k
    return 0


@numba.njit(cache=True)
def standing_things(cells, elevation, clearance, step):
    """What stands and what hangs over the ground `elevation` (rows, cols; NaN unknown).

    Returns (rows, cols) bool, where something higher than `step` reaches lower than `clearance` or where
    there is water, (rows, cols) float64 the clearance under what hangs there, inf where nothing does, and
    (2, rows, cols) float64 the heights between which something was seen to hang, or to stand where it
    reaches lower than `clearance`: inf and -inf where nothing was.
    """
    rows, cols = elevation.shape
    blocked, span = np.zeros((rows, cols), np.bool_), np.empty((2, rows, cols))
    span[0], span[1] = np.inf, -np.inf
    overhang = np.full((rows, cols), np.inf)
    for row in range(rows):
        for col in range(cols):
            blocked[row, col] = cells[row, col, WATER] > 0.0
            stands = cells[row, col, EVIDENCE] >= BLOCKS
            hang = cells[row, col, HANG]
            if not stands and hang == np.inf:
                continue
            ground = _nearest_ground(elevation, row, col) if stands else elevation[row, col]
            if np.isnan(ground):
                ground = cells[row, col, BELOW] if stands else hang - clearance
            if stands and cells[row, col, TOP] - ground > step:
                if cells[row, col, FOOT] - ground >= clearance:
                    hang = min(hang, cells[row, col, FOOT])
                else:
                    blocked[row, col] = True
            overhang[row, col] = max(hang - ground, 0.0)
            span[0, row, col] = cells[row, col, FOOT] if stands else hang
            span[1, row, col] = cells[row, col, PEAK]
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
    for row in range(rows):
        for col in range(cols):
            for dr, dc in ((0, 1), (1, 0), (0, 2), (2, 0)):
                r, c = row + dr, col + dc
                if r >= rows or c >= cols:
                    continue
                rise = elevation[r, c] - elevation[row, col]
                if abs(rise) > step + slope_rise * (dr + dc):
                    if rise > 0.0:
                        high[r, c] = True
                    else:
                        high[row, col] = True
    return high
