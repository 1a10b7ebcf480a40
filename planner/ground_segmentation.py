"""Which returns of a scan lie on the ground and which on things that stand on it.

A column of the scan is the returns of one azimuth, from the lowest beam up. Ground continues from ground at
a slope that ground can have; what rises steeply, or rises above the foot of what stands in front, does not
(in the manner of Himmelsbach et al. 2010 and Zermas et al. 2017, per column instead of per sector).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from scenes.pose import Pose

NOTHING, GROUND, STANDING, UNCLEAR = 0, 1, 2, 3

GROUND_SLOPE = math.tan(math.radians(30.0))  # what is steeper is not ground, and no robot drives there
REGAINED_SLOPE = 0.4  # behind a standing thing, ground is what lies below this slope from its foot
TOLERANCE = 0.06  # two standard deviations of a noisy range
BASELINE = 0.3  # shortest run that a slope is measured over
RISE = 0.15  # a steep rise of as much is the flank of something
LOOK_AHEAD = 5.0  # furthest that the slope of the last ground is believed to go on
EXPECTED_SLOPE = 0.1  # by which the ground may differ from what is expected of it
OVERHANG = 0.5  # a flank does not lean out farther
GROUND_RANGE = 15.0  # farther away, beams are too far apart to tell ground from what stands there
FOOT = 0.5  # the robot stands on the ground at least this far about its middle
_ROUNDING = 1e-6  # metres


@dataclass(frozen=True)
class Scan:
    """One turn of a lidar, or one depth image, in order.

    points : (columns, beams, 3) float64 world points, beams from the lowest up, NaN where nothing usable
        came back
    pose_world_sensor : where it was taken from
    elevations : (beams,) radians of a lidar's beams, whose column k looks along azimuth 2πk/columns in the
        sensor frame; None for a camera
    range_sigma : metres, standard deviation of a range
    wet : (columns, beams) bool, which returns are known to come from water; None where nothing tells
    """

    points: np.ndarray
    pose_world_sensor: Pose
    elevations: np.ndarray | None = None
    range_sigma: float = 0.02
    wet: np.ndarray | None = None


def segment(scan: Scan, pose_world_base: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Label every return of `scan`, taken by a robot that stands at `pose_world_base`.

    Returns (columns, beams) uint8 labels of NOTHING, GROUND, STANDING and UNCLEAR, and two (columns, beams)
    float64: the height of the ground expected below each return, from the ground before it in its column,
    and its distance from the sensor over the ground; NaN where nothing came back.
    """
    up = pose_world_base.rotation[:, 2]
    gradient = -up[:2] / up[2] if up[2] > 0.5 else np.zeros(2)
    return segment_kernel(scan.points, scan.pose_world_sensor.position, pose_world_base.position, gradient)


@numba.njit(cache=True)
def segment_kernel(points, origin, base, gradient):
    """`segment` on arrays: origin (3,) of the sensor, base (3,) of the robot, gradient (2,) of the ground
    that its wheels rest on."""
    columns, beams, _ = points.shape
    labels = np.zeros((columns, beams), np.uint8)
    expected = np.full((columns, beams), np.nan)
    distances = np.empty((columns, beams))
    ground_d, ground_z, above = np.empty(beams + 2), np.empty(beams + 2), np.empty(beams + 1)
    for c in range(columns):
        height, distance = points[c, :, 2], distances[c]
        first = -1
        for i in range(beams):
            if np.isnan(height[i]):
                distance[i] = np.nan
                continue
            distance[i] = math.hypot(points[c, i, 0] - origin[0], points[c, i, 1] - origin[1])
            if first < 0 and distance[i] > 1e-6:
                first = i
        if first < 0:
            continue
        east = (points[c, first, 0] - origin[0]) / distance[first]
        north = (points[c, first, 1] - origin[1]) / distance[first]
        slope = east * gradient[0] + north * gradient[1]
        ground_d[0], ground_d[1] = 0.0, FOOT
        ground_z[0] = (
            base[2] + (origin[0] - base[0]) * gradient[0] + (origin[1] - base[1]) * gradient[1]
        )
        ground_z[1] = ground_z[0] + FOOT * slope
        _segment_column(
            distance, height, origin[2] - ground_z[0], ground_d, ground_z, above, labels[c], expected[c]
        )
    return labels, expected, distances


@numba.njit(cache=True)
def _segment_column(distance, height, mast, ground_d, ground_z, above, labels, expected):
    known = 2
    foot_d, foot_z = -1.0, 0.0
    last = -1
    beams = len(height)
    # How high each return lies over a slope as steep as ground can be: the least of those below, the greatest
    # of those above. Most returns need no further look at either.
    above[beams], below_least = -np.inf, np.inf
    for i in range(beams - 1, -1, -1):
        over = height[i] - GROUND_SLOPE * distance[i]
        above[i] = max(above[i + 1], over) if over == over else above[i + 1]
    for i in range(beams):
        if np.isnan(height[i]):
            continue
        d, z = distance[i], height[i]
        below = _expected_ground(d, ground_d, ground_z, known)
        expected[i] = below
        anchor = known - 1
        while anchor > 0 and d - ground_d[anchor] < BASELINE:
            anchor -= 1
        climbs = z - ground_z[anchor] > GROUND_SLOPE * max(d - ground_d[anchor], 0.0) + TOLERANCE
        hidden_ground = foot_d >= 0.0 and z > foot_z + REGAINED_SLOPE * max(d - foot_d, 0.0) + 0.1
        over = z - GROUND_SLOPE * d
        rises = over - TOLERANCE > below_least - _ROUNDING
        rises_on = above[i + 1] > over + TOLERANCE - _ROUNDING
        below_least = min(below_least, over)
        if climbs or hidden_ground or (rises and _steep_below(i, distance, height)):
            labels[i] = STANDING
        elif rises_on and _steep_above(i, distance, height):
            # The lowest return from a flank: it may lie on the flank or on the ground before it.
            doubt = EXPECTED_SLOPE * (d - ground_d[known - 1])
            labels[i] = STANDING if z - below > RISE + doubt else UNCLEAR
        elif d > GROUND_RANGE or (z > ground_z[known - 1] + RISE and _overlooked(d, ground_d[known - 1])):
            labels[i] = UNCLEAR
        elif z > below + mast and (last != i - 1 or last < 0 or labels[last] != GROUND):
            # Far above the ground expected, only a slope that the beam below met too is ground, no crown.
            labels[i] = UNCLEAR
        else:
            labels[i] = GROUND
            ground_d[known], ground_z[known] = d, z
            known += 1
            foot_d = -1.0
        if labels[i] == STANDING and foot_d < 0.0:
            foot_d, foot_z = d, below
        last = i


@numba.njit(cache=True)
def _expected_ground(d, ground_d, ground_z, known):
    end = known - 1
    start = end - 1
    while start > 0 and ground_d[end] - ground_d[start] < 1.0:
        start -= 1
    run = ground_d[end] - ground_d[start]
    slope = (ground_z[end] - ground_z[start]) / run if run > BASELINE else 0.0
    slope = min(max(slope, -REGAINED_SLOPE), REGAINED_SLOPE)
    return ground_z[end] + slope * min(max(d - ground_d[end], 0.0), LOOK_AHEAD)


@numba.njit(cache=True)
def _overlooked(d, last_ground):
    """Whether the last ground is farther back than the spacing of a lidar's beams on level ground explains:
    then something higher may be ground again or hang there."""
    return d - max(last_ground, 2.0) > 1.0 + 0.05 * d * d


@numba.njit(cache=True)
def _steep_below(i, distance, height):
    """Whether the way up from any lower return in the column is steeper than ground."""
    for k in range(i - 1, -1, -1):
        rise = height[i] - height[k]
        if rise >= RISE and rise > GROUND_SLOPE * (distance[i] - distance[k]) + TOLERANCE:
            return True
    return False


@numba.njit(cache=True)
def _steep_above(i, distance, height):
    """The same upward, for what the next beams meet there: a crown in front or far above says nothing."""
    for j in range(i + 1, len(height)):
        rise = height[j] - height[i]
        if rise >= 0.3 + 0.05 * distance[i]:
            return False
        run = distance[j] - distance[i]
        if rise >= RISE and run > -OVERHANG and rise > GROUND_SLOPE * run + TOLERANCE:
            return True
    return False
