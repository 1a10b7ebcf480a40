"""What a lidar turn looks through is taken from the map whose cells `planner.elevation_kernels` describes."""

from __future__ import annotations

import math

import numba
import numpy as np

from planner.elevation_kernels import EVIDENCE, FOOT, HIGHEST, LOWEST, MEAN, TOP, TURN, WEIGHT
from planner.ground_segmentation import GROUND

SEEN_THROUGH = 2.0  # evidence that a look through takes
PASSED_BELOW = 0.15  # metres: more than a steep slope does within half a cell
GROUND_TURNS = 5
_SLACK = 1e-6  # radians and metres that a rough answer allows for


@numba.njit(cache=True)
def clear_seen_through(
    cells, reach, labels, elevations, origin, rotation, x_min, y_min, resolution, turn
):
    """Take from cells what the newest lidar turn looked through, in place.

    A beam looks through a cell when it passes the cell's middle at a height where something was seen to
    stand and returns from farther away, or from the ground right behind. A beam that does not return says
    nothing, and one return from the cell that is not from the ground says that something is still there.
    Ground is forgotten where a beam passed `PASSED_BELOW` under it; each turn asks that of every
    `GROUND_TURNS`th row.
    reach : (columns, beams) metres over the ground that each beam came, NaN where it did not return
    elevations : (beams,) radians, ascending; origin (3,) and rotation (3, 3) of the sensor in the world
    """
    _, rows, cols = cells.shape
    farthest, tangents = _farthest(reach), np.tan(elevations - _SLACK)
    for row in range(rows):
        asked = (row + int(turn)) % GROUND_TURNS == 0
        north = y_min + row * resolution - origin[1]
        for col in range(cols):
            judged = cells[EVIDENCE, row, col] > 0.0 and cells[TURN, row, col] != turn
            ground = asked and cells[WEIGHT, row, col] > 0.0
            if not judged and not ground:
                continue
            east = x_min + col * resolution - origin[0]
            if math.hypot(east, north) < resolution:
                continue
            if judged:
                low = cells[FOOT, row, col] - 0.05 - origin[2]
                high = cells[TOP, row, col] + 0.05 - origin[2]
                if _may_meet(farthest, tangents, rotation, east, north, high, resolution, resolution):
                    seen, past = _look(
                        reach, labels, elevations, rotation, east, north, low, high, resolution
                    )
                    if seen:
                        cells[TURN, row, col] = turn
                    elif past:
                        cells[EVIDENCE, row, col] = max(cells[EVIDENCE, row, col] - SEEN_THROUGH, 0.0)
            if ground:
                high = cells[MEAN, row, col] - PASSED_BELOW - origin[2]
                if not _may_meet(farthest, tangents, rotation, east, north, high, resolution, 0.0):
                    continue
                _, past = _look(reach, labels, elevations, rotation, east, north, -np.inf, high, resolution)
                if past:
                    cells[WEIGHT, row, col] = 0.0
                    cells[LOWEST, row, col] = cells[HIGHEST, row, col] = np.nan


@numba.njit(cache=True)
def _farthest(reach):
    """The farthest return of each beam and those below it, of its column and of both beside it."""
    columns, beams = reach.shape
    own = np.empty((columns, beams))
    for c in range(columns):
        most = -np.inf
        for i in range(beams):
            if reach[c, i] > most:
                most = reach[c, i]
            own[c, i] = most
    farthest = np.empty((columns, beams))
    for c in range(columns):
        left, right = own[c - 1], own[(c + 1) % columns]
        for i in range(beams):
            farthest[c, i] = max(own[c, i], max(left[i], right[i]))
    return farthest


@numba.njit(cache=True)
def _may_meet(farthest, tangents, rotation, east, north, high, resolution, slack):
    """Whether any beam that passes below `high` can have come as far as `slack` before a cell, by angles
    good to a thousandth of the beams' spacing. Of nearly all cells it cannot, which spares the true angles.

    tangents : (beams,) of the beams' elevations less `_SLACK`
    """
    x = rotation[0, 0] * east + rotation[1, 0] * north + rotation[2, 0] * high
    y = rotation[0, 1] * east + rotation[1, 1] * north + rotation[2, 1] * high
    z = rotation[0, 2] * east + rotation[1, 2] * north + rotation[2, 2] * high
    level = math.sqrt(x * x + y * y)
    last = -1
    while last + 1 < len(tangents) and tangents[last + 1] * level <= z:
        last += 1
    if last < 0:
        return False
    distance = math.sqrt(east * east + north * north)
    columns = farthest.shape[0]
    step = 2.0 * math.pi / columns
    middle = int(_rough_azimuth(x, y) / step + columns)
    aside = int(0.25 * resolution / distance / step + _SLACK)
    for c in range(middle - aside, middle + aside + 2):
        if farthest[c % columns, last] > distance - slack - _SLACK:
            return True
    return False


@numba.njit(cache=True)
def _rough_azimuth(x, y):
    """atan2(y, x) to 1e-5 (Hastings 1955)."""
    ahead, aside = abs(x), abs(y)
    ratio = min(ahead, aside) / max(max(ahead, aside), 1e-300)
    square = ratio * ratio
    angle = ratio * (
        0.9998660 + square * (-0.3302995 + square * (0.1801410 + square * (-0.0851330 + square * 0.0208351)))
    )
    if aside > ahead:
        angle = 0.5 * math.pi - angle
    if x < 0.0:
        angle = math.pi - angle
    return -angle if y < 0.0 else angle


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
