"""Where something that walks its beat is at a given time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise


def patrol_pose(
    waypoints: Sequence[tuple[float, float]], speed: float, loop: bool, yaw: float, time_s: float
) -> tuple[float, float, float]:
    """Position and facing (x, y, yaw) at `time_s` of a walker that starts at the first waypoint.

    waypoints : (x, y) metres; speed : m/s; yaw : facing in radians while standing still.
    loop : close the beat from the last waypoint to the first; otherwise turn back at its end.
    """
    points = list(waypoints)
    if len(points) < 2 or speed <= 0.0:
        return (*points[0], yaw)
    course = [*points, points[0]] if loop else [*points, *reversed(points[:-1])]
    legs = [(a, b, math.dist(a, b)) for a, b in pairwise(course)]
    total = sum(length for *_, length in legs)
    if total <= 0.0:
        return (*points[0], yaw)
    remaining = (speed * time_s) % total
    for a, b, length in legs:
        if length > 0.0 and remaining <= length:
            share = remaining / length
            heading = math.atan2(b[1] - a[1], b[0] - a[0])
            return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), heading
        remaining -= length
    return (*course[-1], yaw)
