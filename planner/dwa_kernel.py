"""The inner loop of the dynamic window: roll every candidate arc out and find what it runs into.

Arcs lie side by side in memory, so that a processor rolls out several at once and looks how near they come to
a point; only what differs from arc to arc is looked at one by one.
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
    poses, facing = np.empty((3, steps + 1, n)), np.empty((2, steps + 1, n))
    heading, distance = np.empty(n), np.empty(n)
    unknown_share, tilt, free_time = np.zeros(n), np.zeros(n), np.empty(n)
    rejection = np.zeros(n, np.int8)
    cos, sin = math.cos(start[2]), math.sin(start[2])
    start_distance = _least_distance(start[0], start[1], cos, sin, half_size, points)
    nearer, too_near = start_distance - leaving[0], start_distance < leaving[1] * contact
    # Where the robot is in a margin or stands on bad ground, it may leave slowly but not make it worse.
    discs = moving.copy()
    for j in range(moving.shape[0]):
        gap = _least_distance(start[0], start[1], cos, sin, half_size, moving[j : j + 1])
        discs[j, 4] = min(moving[j, 4], gap)
    bad_start, tilt_start = 0, 0.0
    if elevation.shape[0] > 0:
        bad_start, _, _, tilt_start = _ground_under(
            start[0], start[1], cos, sin, wheels, elevation, forbidden, origin, tilt_limits
        )
    tilt_limit = max(1.0, tilt_start)

    sideways, limit, farthest = np.empty(n), np.empty(n), 0.0
    free, met = np.full(n, steps), np.empty(n, np.int64)
    for i in range(n):
        limit[i] = contact + speed_margin * abs(v[i])
        if abs(v[i]) <= escape_speed:
            limit[i] = min(limit[i], nearer)
        sideways[i] = slip[0] * w[i] + slip[1] * abs(v[i])
        farthest = max(farthest, math.hypot(v[i], sideways[i]))
    _trace(v, w, sideways, start, dt, heading_share, poses, facing)
    for i in range(n if discs.shape[0] > 0 else 0):
        free[i] = _until_moving(i, poses, facing, dt, half_size, discs)
    nearest = _until_contact(
        poses, facing, free, half_size, farthest * dt, limit, points, start_distance, met
    )

    for i in range(n):
        hazard, last, unknown_step = 0, free[i], steps
        if last < steps:
            hazard = MOVING_OBSTACLE
        if met[i] < last:
            hazard, last = COLLISION, met[i]
        if elevation.shape[0] > 0:
            kind, last, unknown_share[i], unknown_step, tilt[i] = _until_bad_ground(
                i, poses, facing, last, wheels, elevation, forbidden, origin,
                bad_start, tilt_limits, tilt_limit,
            )  # fmt: skip
            hazard = kind if kind != 0 else hazard

        x, y = poses[0, last, i], poses[1, last, i]
        if start_distance < contact:
            nearest[i] = _least_distance(x, y, facing[0, last, i], facing[1, last, i], half_size, points)
        free_time[i] = last * dt
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
        dx, dy = target[0] - x, target[1] - y
        error = math.atan2(dy, dx) - poses[2, last, i]
        heading[i] = abs(error - 2.0 * math.pi * np.rint(error / (2.0 * math.pi)))
        distance[i] = math.sqrt(dx * dx + dy * dy)
    return poses.transpose(2, 1, 0), heading, nearest, distance, unknown_share, tilt, free_time, rejection


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
def _trace(v, w, sideways, start, dt, heading_share, poses, facing):
    """Write the arcs' x, y and yaw into `poses` (3, steps + 1, n), cosine and sine of it into `facing`
    (2, steps + 1, n)."""
    n = len(v)
    turn_cos, turn_sin, share_cos, share_sin = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        turn_cos[i], turn_sin[i] = math.cos(w[i] * dt), math.sin(w[i] * dt)
        share_cos[i], share_sin[i] = math.cos(heading_share * w[i] * dt), math.sin(heading_share * w[i] * dt)
    for i in range(n):
        poses[0, 0, i], poses[1, 0, i], poses[2, 0, i] = start[0], start[1], start[2]
        facing[0, 0, i], facing[1, 0, i] = math.cos(start[2]), math.sin(start[2])
    for k in range(1, poses.shape[1]):
        _step(
            k, v, w, sideways, start[2], dt, turn_cos, turn_sin, share_cos, share_sin,
            poses[0, k - 1], poses[1, k - 1], facing[0, k - 1], facing[1, k - 1],
            poses[0, k], poses[1, k], poses[2, k], facing[0, k], facing[1, k],
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _step(
    k, v, w, sideways, yaw, dt, turn_cos, turn_sin, share_cos, share_sin,
    x, y, cos, sin, new_x, new_y, new_yaw, new_cos, new_sin,
):  # fmt: skip
    """The k-th step of all arcs (n,) from where they are."""
    for i in range(len(v)):
        ahead_x = cos[i] * share_cos[i] - sin[i] * share_sin[i]
        ahead_y = sin[i] * share_cos[i] + cos[i] * share_sin[i]
        new_x[i] = x[i] + dt * (v[i] * ahead_x - sideways[i] * ahead_y)
        new_y[i] = y[i] + dt * (v[i] * ahead_y + sideways[i] * ahead_x)
        new_yaw[i] = yaw + k * w[i] * dt
        new_cos[i] = cos[i] * turn_cos[i] - sin[i] * turn_sin[i]
        new_sin[i] = sin[i] * turn_cos[i] + cos[i] * turn_sin[i]


@njit(cache=True)
def _until_contact(poses, facing, free, half_size, stride, limit, points, nearest, met):
    """Least distance (n,) of each arc's core to a point up to the step `free` (n,) or before the core comes
    within `limit` (n,); `met` (n,) becomes the steps before that.

    stride : metres that no arc's base moves more in a step; nearest : distance at the start
    """
    n, steps = limit.shape[0], poses.shape[1] - 1
    square, least = np.empty(n), np.full(n, nearest * nearest)
    for i in range(n):
        met[i] = 0 if free[i] > 0 and nearest < limit[i] else free[i]
    for k in range(1, steps + 1):
        square[:] = np.inf
        farthest = 0.0
        for i in range(n):
            if k <= met[i]:
                farthest = max(farthest, least[i])
        # A point farther from the start comes no nearer to any core than something has been, and the points
        # after it are farther still.
        reach = math.sqrt(farthest) + math.hypot(half_size[0], half_size[1]) + k * stride + 1e-9
        for j in range(points.shape[0]):
            if points[j, 2] > reach:
                break
            _square_distances(
                points[j, 0], points[j, 1], half_size[0], half_size[1],
                poses[0, k], poses[1, k], facing[0, k], facing[1, k], square,
            )  # fmt: skip
        for i in range(n):
            if k <= met[i]:
                if math.sqrt(square[i]) < limit[i]:
                    met[i] = k - 1
                elif square[i] < least[i]:
                    least[i] = square[i]
    found = np.empty(n)
    for i in range(n):
        found[i] = min(nearest, math.sqrt(least[i]))
    return found


@njit(cache=True, error_model="numpy")
def _square_distances(point_x, point_y, half_length, half_width, x, y, cos, sin, least):
    """Lower `least` (n,) to the square of each core's distance from a point."""
    for i in range(len(x)):
        dx, dy = point_x - x[i], point_y - y[i]
        along = max(abs(cos[i] * dx + sin[i] * dy) - half_length, 0.0)
        across = max(abs(cos[i] * dy - sin[i] * dx) - half_width, 0.0)
        least[i] = min(least[i], along * along + across * across)


@njit(cache=True)
def _until_moving(i, poses, facing, dt, half_size, discs):
    """Steps before the core of arc `i` comes within a moving disc's contact distance."""
    last = poses.shape[1] - 1
    for j in range(discs.shape[0]):
        for k in range(1, last + 1):
            dx = discs[j, 0] + discs[j, 2] * k * dt - poses[0, k, i]
            dy = discs[j, 1] + discs[j, 3] * k * dt - poses[1, k, i]
            along = max(abs(facing[0, k, i] * dx + facing[1, k, i] * dy) - half_size[0], 0.0)
            across = max(abs(facing[0, k, i] * dy - facing[1, k, i] * dx) - half_size[1], 0.0)
            if math.sqrt(along * along + across * across) < discs[j, 4]:
                last = k - 1
                break
    return last


@njit(cache=True)
def _until_bad_ground(
    i, poses, facing, last, wheels, elevation, forbidden, origin, bad_start, tilt_limits, tilt_limit
):  # fmt: skip
    """What ground stops arc `i` by step `last` (0: none), the steps before it, the share of those with a
    wheel on unknown cells, the steps before the first such, and the greatest share of the tilt limits."""
    steps = poses.shape[1] - 1
    unknown_poses, unknown_step, tilt = 0, steps, 0.0
    for k in range(1, last + 1):
        bad, unknown, outside, lean = _ground_under(
            poses[0, k, i], poses[1, k, i], facing[0, k, i], facing[1, k, i],
            wheels, elevation, forbidden, origin, tilt_limits,
        )  # fmt: skip
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
def _least_distance(x, y, cos, sin, half_size, points):
    """From the core at a pose to the nearest point."""
    best = np.inf
    for j in range(points.shape[0]):
        dx, dy = points[j, 0] - x, points[j, 1] - y
        along = max(abs(cos * dx + sin * dy) - half_size[0], 0.0)
        across = max(abs(cos * dy - sin * dx) - half_size[1], 0.0)
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
def _ground_under(x, y, cos, sin, wheels, elevation, forbidden, origin, tilt_limits):
    """Wheels on untraversable cells, on unknown cells, whether one is off the map, share of the limits."""
    rows, cols = elevation.shape
    bad, unknown = 0, 0
    along, across = 0.0, 0.0
    for i in range(4):
        u = (x + wheels[i, 0] * cos - wheels[i, 1] * sin - origin[0]) / origin[2]
        r = (y + wheels[i, 0] * sin + wheels[i, 1] * cos - origin[1]) / origin[2]
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
