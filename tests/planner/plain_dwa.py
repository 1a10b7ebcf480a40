"""The dynamic window's inner loop as plain numpy without short cuts, to compare the kernel with."""

import numpy as np

from planner.frames import Rejection


def roll_out(
    v, w, slip, start, target, steps, dt, heading_share, braking, reaction, creep_speed,
    half_size, contact, speed_margin, escape_speed, leaving, points, moving,
    elevation, forbidden, origin, wheels, tilt_limits,
):  # fmt: skip
    """Arguments and results as `planner.dwa_kernel.roll_out`, but poses (n, steps + 1, 3) first."""
    k = np.arange(1, steps + 1)
    yaw = start[2] + w[:, None] * dt * k
    middle = start[2] + w[:, None] * dt * (k - 1 + heading_share)
    ahead, left = v[:, None] * dt, (slip[0] * w + slip[1] * np.abs(v))[:, None] * dt
    x = start[0] + np.cumsum(ahead * np.cos(middle) - left * np.sin(middle), axis=1)
    y = start[1] + np.cumsum(ahead * np.sin(middle) + left * np.cos(middle), axis=1)
    poses = np.concatenate([np.tile(start, (len(v), 1, 1)), np.stack([x, y, yaw], axis=2)], axis=1)
    gaps = core_distances(poses, points[:, :2], half_size).min(axis=-1, initial=np.inf)
    look = len(elevation) > 0
    ground = ground_under(poses, elevation, forbidden, origin, wheels, tilt_limits) if look else None
    rows = []
    for i in range(len(v)):
        free, hazard = steps, Rejection.NONE
        for disc in moving:
            at = disc[:2] + disc[2:4] * dt * np.arange(steps + 1)[:, None]
            gap = np.diagonal(core_distances(poses[i], at, half_size))
            met = np.flatnonzero(gap[1:] < min(disc[4], gap[0]))
            if len(met) and met[0] < free:
                free, hazard = int(met[0]), Rejection.MOVING_OBSTACLE
        near = gaps[i]
        limit = contact + speed_margin * abs(v[i])
        if abs(v[i]) <= escape_speed:
            limit = min(limit, near[0] - leaving[0])
        met = np.flatnonzero(np.minimum.accumulate(near)[1 : free + 1] < limit)
        if len(met):
            free, hazard = int(met[0]), Rejection.COLLISION
        nearest = near[: free + 1].min()
        tilt, unknown_poses, unknown_step = 0.0, 0, steps
        if ground is not None:
            bad, unknown, outside, lean = (g[i] for g in ground)
            for s in range(1, free + 1):
                kind = (
                    Rejection.OFF_THE_MAP if outside[s]
                    else Rejection.SLOPE if bad[s] > bad[0]
                    else Rejection.TILT if lean[s] > max(1.0, lean[0])
                    else Rejection.NONE
                )  # fmt: skip
                if kind:
                    free, hazard = s - 1, kind
                    break
                tilt = max(tilt, lean[s])
                if unknown[s]:
                    unknown_poses, unknown_step = unknown_poses + 1, min(unknown_step, s - 1)
        verdict = _verdict(
            v[i], w[i], hazard, free * dt, unknown_step, steps, dt, braking, reaction, creep_speed
        )
        if near[0] < contact:
            nearest = near[free]
        creeps = near[0] < leaving[1] * contact and (v[i] or w[i]) and near[free] < near[0] + leaving[2]
        if creeps and verdict != Rejection.MOVING_OBSTACLE:
            verdict = Rejection.COLLISION
        rows.append((nearest, unknown_poses / steps, tilt, free, verdict))
    nearest, unknown_share, tilt, free, rejection = (np.array(column) for column in zip(*rows, strict=True))
    end = poses[np.arange(len(v)), free]
    dx, dy = target[0] - end[:, 0], target[1] - end[:, 1]
    error = np.arctan2(dy, dx) - end[:, 2]
    heading = np.abs(np.arctan2(np.sin(error), np.cos(error)))
    return poses, heading, nearest, np.hypot(dx, dy), unknown_share, tilt, free * dt, rejection


def _verdict(v, w, hazard, free_time, unknown_step, steps, dt, braking, reaction, creep_speed):
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = reaction + max(
            abs(v) / (2.0 * braking[0]) if v else 0.0, abs(w) / (2.0 * braking[1]) if w else 0.0
        )
    if hazard == Rejection.MOVING_OBSTACLE:
        return hazard
    if hazard and free_time < needed:
        return Rejection.CANNOT_STOP if hazard == Rejection.COLLISION and free_time > reaction else hazard
    if abs(v) > creep_speed and unknown_step < steps and unknown_step * dt < needed:
        return Rejection.UNKNOWN_GROUND
    return Rejection.NONE


def core_distances(poses, points, half_size):
    """(..., m) from a rectangle at each pose (..., 3) to each point (m, 2)."""
    offset = points - poses[..., None, :2]
    cos, sin = np.cos(poses[..., 2])[..., None], np.sin(poses[..., 2])[..., None]
    along = np.abs(cos * offset[..., 0] + sin * offset[..., 1]) - half_size[0]
    across = np.abs(cos * offset[..., 1] - sin * offset[..., 0]) - half_size[1]
    return np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))


def ground_under(poses, elevation, forbidden, origin, wheels, tilt_limits):
    """Per pose: wheels on forbidden and on unknown cells, whether one is off the map, share of the limits."""
    cos, sin = np.cos(poses[..., 2])[..., None], np.sin(poses[..., 2])[..., None]
    u = (poses[..., None, 0] + cos * wheels[:, 0] - sin * wheels[:, 1] - origin[0]) / origin[2]
    r = (poses[..., None, 1] + sin * wheels[:, 0] + cos * wheels[:, 1] - origin[1]) / origin[2]
    rows, cols = elevation.shape
    row, col = np.rint(r).astype(int), np.rint(u).astype(int)
    off = (row < 0) | (row >= rows) | (col < 0) | (col >= cols)
    row, col = np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)
    heights = bilinear(u, r, elevation)
    heights = np.where(np.isnan(heights), elevation[row, col], heights)
    along = (heights[..., 0] + heights[..., 1] - heights[..., 2] - heights[..., 3]) / (
        2 * (wheels[0, 0] - wheels[2, 0])
    )
    across = (heights[..., 0] + heights[..., 2] - heights[..., 1] - heights[..., 3]) / (
        2 * (wheels[0, 1] - wheels[1, 1])
    )
    lean = np.nan_to_num(np.hypot(along / tilt_limits[0], across / tilt_limits[1]))
    return (
        forbidden[row, col].sum(axis=-1), np.isnan(elevation[row, col]).sum(axis=-1), off.any(axis=-1), lean,
    )  # fmt: skip


def bilinear(u, r, elevation):
    rows, cols = elevation.shape
    col = np.clip(np.floor(u).astype(int), 0, cols - 2)
    row = np.clip(np.floor(r).astype(int), 0, rows - 2)
    du, dr = np.clip(u - col, 0.0, 1.0), np.clip(r - row, 0.0, 1.0)
    south = (1 - du) * elevation[row, col] + du * elevation[row, col + 1]
    north = (1 - du) * elevation[row + 1, col] + du * elevation[row + 1, col + 1]
    return (1 - dr) * south + dr * north
