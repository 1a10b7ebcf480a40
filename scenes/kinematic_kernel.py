"""The inner loop of `scenes.kinematics`: the drive's response, the slope's pull, and what is run into."""

from __future__ import annotations

import math

from numba import njit

X, Y, YAW, REFERENCE_V, REFERENCE_W, SPEED, YAW_RATE, DRIVEN, TURNED = range(9)
STATE_SIZE = 9
"""The state: metres, radians and their rates; the reference is what the drive follows the command with."""

FREE, AT_THE_BORDER = -1, -2


@njit(cache=True)
def ground_height(heights, resolution, x_min, y_min, x, y):
    """As `scenes.terrain.Heightmap.height_at`, for one point."""
    rows, cols = heights.shape
    u = min(max((x - x_min) / resolution, 0.0), cols - 1.0)
    v = min(max((y - y_min) / resolution, 0.0), rows - 1.0)
    col, row = min(int(u), cols - 2), min(int(v), rows - 2)
    u, v = u - col, v - row
    east, north = heights[row, col + 1], heights[row + 1, col]
    if u + v <= 1.0:
        near = heights[row, col]
        return near + u * (east - near) + v * (north - near)
    far = heights[row + 1, col + 1]
    return far + (1.0 - u) * (north - far) + (1.0 - v) * (east - far)


@njit(cache=True)
def slopes(heights, resolution, x_min, y_min, x, y, yaw, axle_x, axle_y):
    """Rise to the front and to the left, metres a metre, of the ground under the four wheels on the mean."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    rise, bank = 0.0, 0.0
    for sx in (-1.0, 1.0):
        for sy in (-1.0, 1.0):
            px, py = sx * axle_x, sy * axle_y
            z = ground_height(
                heights, resolution, x_min, y_min, x + cos * px - sin * py, y + sin * px + cos * py
            )
            rise += 0.25 * sx * z / axle_x
            bank += 0.25 * sy * z / axle_y
    return rise, bank


@njit(cache=True)
def collides(x, y, yaw, half_length, half_width, corners, count, radius):
    """Whether the robot's rectangle meets a convex outline: `count` of the corners (n, 2), grown by `radius`
    where it is a single point."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    if count == 1:
        dx, dy = corners[0, 0] - x, corners[0, 1] - y
        ahead = max(abs(cos * dx + sin * dy) - half_length, 0.0)
        aside = max(abs(cos * dy - sin * dx) - half_width, 0.0)
        return ahead * ahead + aside * aside <= radius * radius
    for axis in range(count + 2):
        if axis >= count:
            nx, ny = (cos, sin) if axis == count else (-sin, cos)
        else:
            ex = corners[(axis + 1) % count, 0] - corners[axis, 0]
            ey = corners[(axis + 1) % count, 1] - corners[axis, 1]
            length = math.hypot(ex, ey)
            if length == 0.0:
                continue
            nx, ny = ey / length, -ex / length
        reach = half_length * abs(nx * cos + ny * sin) + half_width * abs(ny * cos - nx * sin)
        low, high = math.inf, -math.inf
        for corner in range(count):
            along = nx * (corners[corner, 0] - x) + ny * (corners[corner, 1] - y)
            low, high = min(low, along), max(high, along)
        if low > reach or high < -reach:
            return False
    return True


@njit(cache=True)
def drive(
    state, command, limits, response, steps, dt, heights, resolution, x_min, y_min, body,
    corners, counts, radii,
):  # fmt: skip
    """Move `state` (9,) on by `steps` of `dt` seconds toward `command` (v, w); it is changed in place.

    limits : accelerations (m/s², rad/s²); body : half length, half width, axle x, axle y
    corners (k, n, 2), counts (k,), radii (k,) : convex outlines that stand in the way
    Returns the index of the outline that was run into, `FREE`, or `AT_THE_BORDER` of the map; the robot stops
    where it was last free.
    """
    speed_lag, speed_gain, yaw_gain, slide_turning, slide_driving, side_slip = response
    half_length, half_width, axle_x, axle_y = body
    speed_share = 1.0 - math.exp(-dt / speed_lag)
    for _ in range(steps):
        state[REFERENCE_V] += min(max(command[0] - state[REFERENCE_V], -limits[0] * dt), limits[0] * dt)
        state[REFERENCE_W] += min(max(command[1] - state[REFERENCE_W], -limits[1] * dt), limits[1] * dt)
        x, y, yaw = state[X], state[Y], state[YAW]
        rise, bank = slopes(heights, resolution, x_min, y_min, x, y, yaw, axle_x, axle_y)
        v, w = state[REFERENCE_V], state[REFERENCE_W]
        state[SPEED] += speed_share * (speed_gain * v - state[SPEED])
        state[YAW_RATE] = yaw_gain * w
        sliding = slide_turning * abs(state[YAW_RATE]) + slide_driving * abs(state[SPEED])
        aside = -side_slip * state[SPEED] * state[YAW_RATE] - sliding * bank
        level = state[SPEED] / math.sqrt(1.0 + rise * rise)
        middle = yaw + 0.5 * dt * state[YAW_RATE]
        cos, sin = math.cos(middle), math.sin(middle)
        new_x = x + dt * (cos * level - sin * aside)
        new_y = y + dt * (sin * level + cos * aside)
        new_yaw = yaw + dt * state[YAW_RATE]
        met = FREE
        rows, cols = heights.shape
        if not (
            x_min <= new_x <= x_min + (cols - 1) * resolution
            and y_min <= new_y <= y_min + (rows - 1) * resolution
        ):
            met = AT_THE_BORDER
        for index in range(len(counts)):
            if collides(
                new_x, new_y, new_yaw, half_length, half_width, corners[index], counts[index], radii[index]
            ):
                met = index
                break
        if met != FREE:
            state[REFERENCE_V] = state[REFERENCE_W] = state[SPEED] = state[YAW_RATE] = 0.0
            return met
        state[DRIVEN] += dt * state[SPEED]
        state[TURNED] += dt * state[YAW_RATE]
        state[X], state[Y], state[YAW] = new_x, new_y, new_yaw
    return FREE
