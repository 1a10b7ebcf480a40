"""Where no arc is admissible: what bars them, which one evades what comes, and which way is free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.dwa import Rollout
from planner.frames import Arcs, Percept, Rejection, TrackedObstacle

REASONS = {
    Rejection.COLLISION: "an obstacle is too near",
    Rejection.CANNOT_STOP: "no arc stops before the obstacle ahead",
    Rejection.MOVING_OBSTACLE: "something that moves is in the way",
    Rejection.SLOPE: "the ground ahead is too steep",
    Rejection.TILT: "the robot would tilt too far",
    Rejection.UNKNOWN_GROUND: "the ground ahead is unknown",
    Rejection.OFF_THE_MAP: "the map ends here",
}


def main_reason(arcs: Arcs) -> str:
    """Why most of the arcs are rejected, in words."""
    counts = np.bincount(arcs.rejection, minlength=len(Rejection))
    counts[Rejection.NONE] = 0
    return f"no admissible arc, {REASONS[Rejection(int(np.argmax(counts)))]}"


def crowded(rollout: Rollout) -> bool:
    """Whether something that moves bars an arc."""
    return bool((rollout.arcs.rejection == Rejection.MOVING_OBSTACLE).any())


def evasive_arc(rollout: Rollout, moving: Sequence[TrackedObstacle], dt: float) -> int:
    """The arc, of poses `dt` seconds apart, that something moving meets latest; of several the one that is
    farthest from all at its end. -1 where nothing that moves is in the way."""
    if not crowded(rollout):
        return -1
    threatened = rollout.arcs.rejection == Rejection.MOVING_OBSTACLE
    latest = rollout.free_time[threatened].max()
    arcs = np.flatnonzero(threatened & (rollout.free_time >= latest - 1e-9))
    poses = rollout.arcs.poses[arcs]
    seconds = dt * (poses.shape[1] - 1)
    away = np.full(len(arcs), np.inf)
    for thing in moving:
        x, y = thing.x + seconds * thing.vx, thing.y + seconds * thing.vy
        away = np.minimum(away, np.hypot(poses[:, -1, 0] - x, poses[:, -1, 1] - y) - thing.radius)
    return int(arcs[np.argmax(away)])


def corridors(percept: Percept, bearings: np.ndarray, half_width: float, reach: float) -> np.ndarray:
    """(n,) metres that a disc of `half_width` can go along each world bearing before an obstacle point, at
    most `reach`."""
    offsets = percept.obstacle_points - (percept.pose.x, percept.pose.y)
    along = np.cos(bearings)[:, None] * offsets[:, 0] + np.sin(bearings)[:, None] * offsets[:, 1]
    across = np.cos(bearings)[:, None] * offsets[:, 1] - np.sin(bearings)[:, None] * offsets[:, 0]
    ahead = (np.abs(across) < half_width) & (along > 0.0)
    return np.min(np.where(ahead, along, reach), axis=1, initial=reach)
