"""What DWA-RL looks at: the velocities of the dynamic window, and what each would cost among the obstacles of
now and of the last seconds.

Patel et al. 2021 (DWA-RL) and its published code. Its robot is a point with 0.15 m about it; here distances
are from the outline of the Husky. Its velocities leave out the upper ends of the window; here both are in.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from planner.dwa import DwaConfig, window
from planner.frames import TrackedObstacle
from planner.tracking import outline_discs
from scenes.pose import Pose, Twist

CHANNELS = ("v", "w", "obstacle", "goal")


@dataclass(frozen=True)
class WindowConfig:
    """velocities : of each axis of the window; sets : of obstacles, past ones and the newest
    kept : ticks from one set that is kept to the next; the newest is replaced at every tick
    horizon : seconds of an arc; stride : its poses that are looked at, every so many
    touching, touch_cost : metres from the outline within which an obstacle costs so much, and 1/m beyond
    reach : metres from the robot beyond which obstacles do not matter
    goal_gain, speed_gain, obstacle_gain : of the total cost that the velocities are sorted by, per metre
        between arc's end and target, per m/s short of the highest speed, and per unit of obstacle cost
    """

    velocities: int = 12
    sets: int = 10
    kept: int = 5
    horizon: float = 1.5
    stride: int = 2
    touching: float = 0.15
    touch_cost: float = 40.0
    reach: float = 4.0
    goal_gain: float = 2.4
    speed_gain: float = 0.1
    obstacle_gain: float = 3.2

    @property
    def rows(self) -> int:
        return self.velocities**2


WINDOW = WindowConfig()


def velocities(
    config: DwaConfig, twist: Twist, count: int = WINDOW.velocities
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and yaw rates (count²,) each, evenly over what can be reached within a control period."""
    v_low, v_high, w_low, w_high = window(config, twist)
    v, w = np.linspace(v_low, v_high, count), np.linspace(w_low, w_high, count)
    return np.tile(v, count), np.repeat(w, count)


class MovingHistory:
    """Where moving obstacles were: the newest set, and earlier ones half a second apart."""

    def __init__(self, config: WindowConfig = WINDOW):
        self.config = config
        self._kept: deque[np.ndarray] = deque(maxlen=config.sets)
        self._ticks = 0

    def see(self, pose: Pose, moving: Sequence[TrackedObstacle]) -> None:
        """Once a tick: what moves near the robot now."""
        discs = [
            (x, y, radius)
            for thing in moving
            for x, y, radius in outline_discs(thing)
            if math.hypot(x - pose.x, y - pose.y) - radius < self.config.reach
        ]
        newest = np.array(discs, float).reshape(-1, 3)
        if not self._kept:
            self._kept.extend([newest] * self.config.sets)
        elif self._ticks % self.config.kept == 0:
            self._kept.append(newest)
        else:
            self._kept[-1] = newest
        self._ticks += 1

    def discs(self) -> np.ndarray:
        """(k, 4) x, y, radius and the number of its set, the newest set last."""
        numbers = np.repeat(np.arange(len(self._kept)), [len(discs) for discs in self._kept])
        return np.column_stack([np.concatenate([np.zeros((0, 3)), *self._kept]), numbers])


@dataclass(frozen=True)
class WindowView:
    """The window as the policy reads it; `order` (rows,) says which velocity each row is of.

    tensor : (rows, sets, 4) float32: v in m/s, w in rad/s, obstacle cost and to-goal cost, both divided by
        their greatest; rows by growing total cost of the newest set
    total : (rows,) that cost
    """

    tensor: np.ndarray
    order: np.ndarray
    total: np.ndarray


def view_window(
    v: np.ndarray,
    w: np.ndarray,
    poses: np.ndarray,
    target: tuple[float, float],
    points: np.ndarray,
    moving: np.ndarray,
    dwa: DwaConfig,
    max_speed: float,
    config: WindowConfig = WINDOW,
) -> WindowView:
    """See the velocities v, w (rows,) with their arcs' poses (rows, steps + 1, 3) of x, y and yaw.

    points : (m, 2) of what stands, the same in all sets; moving : (k, 4) as `MovingHistory.discs`
    """
    here = poses[0, 0]
    standing = points[np.hypot(points[:, 0] - here[0], points[:, 1] - here[1]) < config.reach]
    half = 0.5 * np.array([dwa.footprint.length, dwa.footprint.width])
    looked_at = np.ascontiguousarray(poses[:, :: config.stride])
    distance = set_distances(looked_at, half, standing, moving, config.sets) - dwa.footprint.radius
    with np.errstate(divide="ignore"):
        obstacle = np.where(distance <= config.touching, config.touch_cost, 1.0 / np.maximum(distance, 1e-9))
    obstacle = config.obstacle_gain * obstacle
    goal = config.goal_gain * np.hypot(target[0] - poses[:, -1, 0], target[1] - poses[:, -1, 1])
    total = goal + config.speed_gain * (max_speed - v) + obstacle[:, -1]
    order = np.argsort(total, kind="stable")
    tensor = np.empty((len(v), config.sets, len(CHANNELS)), np.float32)
    tensor[:, :, 0], tensor[:, :, 1] = v[order, None], w[order, None]
    tensor[:, :, 2] = obstacle[order] / max(float(obstacle.max()), 1e-9)
    tensor[:, :, 3] = goal[order, None] / max(float(goal.max()), 1e-9)
    return WindowView(tensor, order, total[order])


@njit(cache=True)
def set_distances(poses, half_size, points, discs, sets):
    """(n, sets) least distance from the rectangle of half size (2,) at any of the poses (n, k, 3) to what is
    in each set, inf where that is nothing.

    points : (m, 2) x and y, in all sets; discs : (l, 4) x, y, radius and the one set that each is in
    """
    n, steps = poses.shape[0], poses.shape[1]
    best = np.full((n, sets), np.inf)
    for i in range(n):
        nearest = np.inf
        for k in range(steps):
            x, y = poses[i, k, 0], poses[i, k, 1]
            cos, sin = math.cos(poses[i, k, 2]), math.sin(poses[i, k, 2])
            for j in range(points.shape[0]):
                dx, dy = points[j, 0] - x, points[j, 1] - y
                along = max(abs(cos * dx + sin * dy) - half_size[0], 0.0)
                across = max(abs(cos * dy - sin * dx) - half_size[1], 0.0)
                nearest = min(nearest, along * along + across * across)
            for j in range(discs.shape[0]):
                dx, dy = discs[j, 0] - x, discs[j, 1] - y
                along = max(abs(cos * dx + sin * dy) - half_size[0], 0.0)
                across = max(abs(cos * dy - sin * dx) - half_size[1], 0.0)
                number = int(discs[j, 3])
                away = math.sqrt(along * along + across * across) - discs[j, 2]
                best[i, number] = min(best[i, number], away)
        for number in range(sets):
            best[i, number] = min(best[i, number], math.sqrt(nearest))
    return best
