"""The inner loop of the dynamic window: roll every candidate arc out and find what it runs into.

Each check walks one whole arc in one call: passing arrays to a function costs more than a step of it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

COLLISION, CANNOT_STOP, MOVING_OBSTACLE, SLOPE, TILT, UNKNOWN_GROUND, OFF_THE_MAP = 1, 2, 3, 4, 5, 6, 7


@njit(cache=True)
def roll_out(
    v, w, slip, start, target, steps, dt, heading_share, braking, reaction, creep_speed,
    half_size, contact, speed_margin, escape_speed, leaving, points, moving,
    elevation, forbidden, origin, wheels, tilt_limits,
):  # fmt: skip
    """Every arc as far as it is free, and why it is not admissible.

    v, w : (n,) m/s, rad/s; start : (3,) x, y, yaw; target : (2,)
    slip : (2,) m to the left that the base slips for each radian it turns and each metre it drives
    heading_share : share of a step's turn taken before its translation (0.5: midpoint rule, 1: Euler)
    braking : (2,) m/s² and rad/s² the robot can surely stop with, 0 for "not at all"; reaction : s
    creep_speed : m/s at which unknown ground may be entered
    half_size : (2,) half length and half width of the footprint's core, a rectangle; nearer to it than
        `contact`, and `speed_margin` more for each m/s, nothing may come; up to `escape_speed` a robot that
        is nearer already may leave
    leaving : (3,) how a robot that is nearer leaves: metres that something may come nearer meanwhile, for no
        turn keeps a distance exactly; the share of `contact` below which an arc must end farther away than it
        began, for a robot that may end nearer creeps into things bit by bit; and by how many metres
    points : (m, 3) obstacle points x, y and distance from the start, nearest first
    moving : (k, 5) discs x, y, vx, vy, contact distance
    elevation, forbidden : (rows, cols) ground heights (NaN unknown) and untraversable cells, cell [0, 0] at
        `origin` (x, y, resolution); no rows: the ground is not looked at
    wheels : (4, 2) contact points front left, front right, rear left, rear right
    tilt_limits : (2,) tangents of the greatest pitch and roll; both together count as a share of 1

    Returns poses (n, steps + 1, 3) of x, y and yaw, heading error at the end of the free
    part (rad), least distance of a point to the core before contact (m; where the arc starts nearer than
    `contact`, that at the end of the free part), distance to the target at the end of the free part (m),
    share of poses with a wheel on unknown ground, greatest share of the tilt limits, time free of hazards
    (s), rejection (int8).
    """
    n = v.shape[0]
    poses, path = np.empty((n, steps + 1, 3)), np.empty((steps + 1, 5))
    heading, distance, nearest = np.empty(n), np.empty(n), np.empty(n)
    unknown_share, tilt, free_time = np.zeros(n), np.zeros(n), np.empty(n)
    rejection = np.zeros(n, np.int8)
    here = np.array([start[0], start[1], start[2], math.cos(start[2]), math.sin(start[2])])
    reach = math.hypot(half_size[0], half_size[1])
    start_distance = _least_distance(here, half_size, points)
    nearer, too_near = start_distance - leaving[0], start_distance < leaving[1] * contact
    # Where the robot is in a margin or stands on bad ground, it may leave slowly but not make it worse.
    discs = moving.copy()
    for j in range(moving.shape[0]):
        discs[j, 4] = min(moving[j, 4], _least_distance(here, half_size, moving[j : j + 1]))
    bad_start, tilt_start = 0, 0.0
    if elevation.shape[0] > 0:
        bad_start, _, _, tilt_start = _ground_under(here, wheels, elevation, forbidden, origin, tilt_limits)
    tilt_limit = max(1.0, tilt_start)

    for i in range(n):
        limit = contact + speed_margin * abs(v[i])
        if abs(v[i]) <= escape_speed:
            limit = min(limit, nearer)
        sideways = slip[0] * w[i] + slip[1] * abs(v[i])
        _trace(v[i], w[i], sideways, here, dt, heading_share, path)
        for k in range(steps + 1):
            poses[i, k, 0], poses[i, k, 1], poses[i, k, 2] = path[k, 0], path[k, 1], path[k, 2]
        speed = math.hypot(v[i], sideways)
        hazard, free, unknown_step = 0, steps, steps
        if discs.shape[0] > 0:
            free = _until_moving(path, dt, half_size, discs)
            hazard = MOVING_OBSTACLE if free < steps else 0
        last, nearest[i] = _until_contact(
            path, free, speed * dt, reach * abs(w[i]) * dt, half_size, reach, limit, points, start_distance
        )
        if last < free:
            hazard, free = COLLISION, last
        if elevation.shape[0] > 0:
            kind, free, unknown_share[i], unknown_step, tilt[i] = _until_bad_ground(
                path, free, wheels, elevation, forbidden, origin, bad_start, tilt_limits, tilt_limit
            )
            hazard = kind if kind != 0 else hazard

        if start_distance < contact:
            nearest[i] = _least_distance(path[free], half_size, points)
        free_time[i] = free * dt
        needed = reaction + max(_brake_time(v[i], braking[0]), _brake_time(w[i], braking[1]))
        if hazard == MOVING_OBSTACLE:
            # Standing still does not help against what comes nearer.
            rejection[i] = MOVING_OBSTACLE
        elif too_near and (v[i] != 0.0 or w[i] != 0.0) and nearest[i] < start_distance + leaving[2]:
            rejection[i] = COLLISION
        elif hazard != 0 and free_time[i] < needed:
            rejection[i] = CANNOT_STOP if hazard == COLLISION and free_time[i] > reaction else hazard
        elif abs(v[i]) > creep_speed and unknown_step < steps and unknown_step * dt < needed:
            rejection[i] = UNKNOWN_GROUND
        dx, dy = target[0] - path[free, 0], target[1] - path[free, 1]
        error = math.atan2(dy, dx) - path[free, 2]
        heading[i] = abs(error - 2.0 * math.pi * np.rint(error / (2.0 * math.pi)))
        distance[i] = math.sqrt(dx * dx + dy * dy)
    return poses, heading, nearest, distance, unknown_share, tilt, free_time, rejection


@njit(cache=True, error_model="numpy")
def weigh(
    v, heading, nearest, distance, unknown, tilt, rejection,
    of_heading, of_clearance, of_velocity, of_goal, of_unknown, of_tilt, fastest, clearance_reach,
):  # fmt: skip
    """What each arc (n,) costs, by `roll_out`'s answers and the weight of each: the terms (5, n) heading,
    clearance, velocity, goal and ground, their sum (n,), inf for a rejected arc, and the index of the
    cheapest, -1 where all are rejected."""
    n = len(v)
    terms, total = np.empty((5, n)), np.empty(n)
    chosen, least = -1, np.inf
    for i in range(n):
        terms[0, i] = of_heading * heading[i]
        terms[1, i] = of_clearance * max(0.0, 1.0 / nearest[i] - 1.0 / clearance_reach)
        terms[2, i] = of_velocity * abs(fastest - v[i])
        terms[3, i] = of_goal * distance[i]
        terms[4, i] = of_unknown * unknown[i] + of_tilt * tilt[i]
        total[i] = np.inf
        if rejection[i] == 0:
            total[i] = terms[0, i] + terms[1, i] + terms[2, i] + terms[3, i] + terms[4, i]
            if total[i] < least:
                chosen, least = i, total[i]
    return terms, total, chosen


@njit(cache=True)
def _trace(v, w, sideways, here, dt, heading_share, path):
    """Write one arc's poses, with the cosine and sine of their yaw, into `path` (steps + 1, 5)."""
    x, y, yaw, cos, sin = here
    path[0] = here
    share_cos, share_sin = math.cos(heading_share * w * dt), math.sin(heading_share * w * dt)
    turn_cos, turn_sin = math.cos(w * dt), math.sin(w * dt)
    for k in range(1, path.shape[0]):
        ahead_x, ahead_y = cos * share_cos - sin * share_sin, sin * share_cos + cos * share_sin
        x += dt * (v * ahead_x - sideways * ahead_y)
        y += dt * (v * ahead_y + sideways * ahead_x)
        cos, sin = cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin
        path[k, 0], path[k, 1], path[k, 2], path[k, 3], path[k, 4] = x, y, yaw + k * w * dt, cos, sin


@njit(cache=True)
def _until_contact(path, last, stride, swing, half_size, reach, limit, points, nearest):
    """Steps up to `last` before the core comes within `limit` of a point; least distance until then.

    stride, swing : metres that the base moves in a step, and the core's corners by turning; a distance
        changes by no more, so that steps are left out while the nearest point cannot come nearer than before
    """
    if last > 0 and nearest < limit:
        return 0, nearest
    k = 1
    while k <= last:
        x, y, cos, sin = path[k, 0], path[k, 1], path[k, 3], path[k, 4]
        driven = k * stride + reach
        best, best_square = np.inf, np.inf
        for j in range(points.shape[0]):
            # A point at range r from the start cannot be nearer than this to the core by now.
            if points[j, 2] - driven >= best:
                break
            dx, dy = points[j, 0] - x, points[j, 1] - y
            along = max(abs(cos * dx + sin * dy) - half_size[0], 0.0)
            across = max(abs(cos * dy - sin * dx) - half_size[1], 0.0)
            square = along * along + across * across
            if square < best_square:
                best_square = square
                best = math.sqrt(square)
        if best < nearest:
            if best < limit:
                return k - 1, nearest
            nearest = best
            k += 1
        else:
            k += 1 + int(min((best - nearest) / (stride + swing + 1e-9), last))
    return last, nearest


@njit(cache=True)
def _until_moving(path, dt, half_size, discs):
    """Steps before the core comes within a moving disc's contact distance."""
    last = path.shape[0] - 1
    for j in range(discs.shape[0]):
        for k in range(1, last + 1):
            dx = discs[j, 0] + discs[j, 2] * k * dt - path[k, 0]
            dy = discs[j, 1] + discs[j, 3] * k * dt - path[k, 1]
            along = max(abs(path[k, 3] * dx + path[k, 4] * dy) - half_size[0], 0.0)
            across = max(abs(path[k, 3] * dy - path[k, 4] * dx) - half_size[1], 0.0)
            if math.sqrt(along * along + across * across) < discs[j, 4]:
                last = k - 1
                break
    return last


@njit(cache=True)
def _until_bad_ground(
    path, last, wheels, elevation, forbidden, origin, bad_start, tilt_limits, tilt_limit
):  # fmt: skip
    """What ground stops the arc by step `last` (0: none), the steps before it, the share of those with a
    wheel on unknown cells, the steps before the first such, and the greatest share of the tilt limits."""
    steps = path.shape[0] - 1
    unknown_poses, unknown_step, tilt = 0, steps, 0.0
    for k in range(1, last + 1):
        bad, unknown, outside, lean = _ground_under(
            path[k], wheels, elevation, forbidden, origin, tilt_limits
        )
        kind = 0
        if outside:
            kind = OFF_THE_MAP
        elif bad > bad_start:
            kind = SLOPE
        elif lean > tilt_limit:
            kind = TILT
        if kind != 0:
            return kind, k - 1, unknown_poses / steps, unknown_step, tilt
        tilt = max(tilt, lean)
        if unknown > 0:
            unknown_poses += 1
            unknown_step = min(unknown_step, k - 1)
    return 0, last, unknown_poses / steps, unknown_step, tilt


@njit(cache=True)
def _least_distance(pose, half_size, points):
    """From the core to the nearest point."""
    best = np.inf
    for j in range(points.shape[0]):
        dx, dy = points[j, 0] - pose[0], points[j, 1] - pose[1]
        along = max(abs(pose[3] * dx + pose[4] * dy) - half_size[0], 0.0)
        across = max(abs(pose[3] * dy - pose[4] * dx) - half_size[1], 0.0)
        best = min(best, math.sqrt(along * along + across * across))
    return best


@njit(cache=True)
def _brake_time(speed, braking):
    """Time along an arc at `speed` that covers the braking distance speed² / (2 · braking)."""
    if speed == 0.0:
        return 0.0
    if braking <= 0.0:
        return np.inf
    return abs(speed) / (2.0 * braking)


@njit(cache=True)
def _ground_under(pose, wheels, elevation, forbidden, origin, tilt_limits):
    """Wheels on untraversable cells, on unknown cells, whether one is off the map, share of the limits."""
    rows, cols = elevation.shape
    bad, unknown = 0, 0
    along, across = 0.0, 0.0
    for i in range(4):
        u = (pose[0] + wheels[i, 0] * pose[3] - wheels[i, 1] * pose[4] - origin[0]) / origin[2]
        r = (pose[1] + wheels[i, 0] * pose[4] + wheels[i, 1] * pose[3] - origin[1]) / origin[2]
        col, row = int(np.rint(u)), int(np.rint(r))
        if row < 0 or row >= rows or col < 0 or col >= cols:
            return bad, unknown, True, 0.0
        if forbidden[row, col]:
            bad += 1
        if math.isnan(elevation[row, col]):
            unknown += 1
        height = _height(u, r, elevation)
        along += height if i < 2 else -height
        across += height if i % 2 == 0 else -height
    along /= 2.0 * (wheels[0, 0] - wheels[2, 0]) * tilt_limits[0]
    across /= 2.0 * (wheels[0, 1] - wheels[1, 1]) * tilt_limits[1]
    lean = math.sqrt(along * along + across * across)
    return bad, unknown, False, 0.0 if math.isnan(lean) else lean


@njit(cache=True)
def _height(u, r, elevation):
    """Bilinear height at column u, row r; the nearest cell's where a neighbour is unknown."""
    rows, cols = elevation.shape
    col = min(max(math.floor(u), 0), cols - 2)
    row = min(max(math.floor(r), 0), rows - 2)
    du, dr = min(max(u - col, 0.0), 1.0), min(max(r - row, 0.0), 1.0)
    south = (1.0 - du) * elevation[row, col] + du * elevation[row, col + 1]
    north = (1.0 - du) * elevation[row + 1, col] + du * elevation[row + 1, col + 1]
    height = (1.0 - dr) * south + dr * north
    if math.isnan(height):
        height = elevation[int(np.rint(r)), int(np.rint(u))]
    return height
