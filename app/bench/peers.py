"""What the bench compares with where no library does the job: references in plain Python and NumPy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from planner.elevation_map import MapConfig, window_origin
from scenes.pose import Pose

PATCH_CELLS, PATCH_RESOLUTION = 40, 0.5


@dataclass(frozen=True)
class ReferenceDwa:
    """The dynamic window approach as it is commonly taught (Fox et al. 1997, and PythonRobotics' description
    of it), with that project's default sampling: speeds every 0.01 m/s, yaw rates every 0.1°, 3 s ahead at
    0.1 s, a round robot.

    Metres, seconds, radians. As there, the state is a vector (x, y, yaw, v, w), and a trajectory is stacked
    from such rows step by step.
    """

    max_speed: float = 1.0
    min_speed: float = -0.5
    max_yaw_rate: float = math.radians(40.0)
    acceleration: float = 0.2
    yaw_acceleration: float = math.radians(40.0)
    speed_step: float = 0.01
    yaw_rate_step: float = math.radians(0.1)
    dt: float = 0.1
    horizon: float = 3.0
    heading_gain: float = 0.15
    speed_gain: float = 1.0
    obstacle_gain: float = 1.0
    radius: float = 1.0

    def velocities(self, v: float, w: float) -> tuple[np.ndarray, np.ndarray]:
        """The window's speeds and yaw rates, from its lower limits on."""
        low_v = max(self.min_speed, v - self.acceleration * self.dt)
        high_v = min(self.max_speed, v + self.acceleration * self.dt)
        low_w = max(-self.max_yaw_rate, w - self.yaw_acceleration * self.dt)
        high_w = min(self.max_yaw_rate, w + self.yaw_acceleration * self.dt)
        return np.arange(low_v, high_v, self.speed_step), np.arange(low_w, high_w, self.yaw_rate_step)

    def choose(
        self, state: np.ndarray, goal: np.ndarray, obstacles: np.ndarray
    ) -> tuple[float, float, float]:
        """Speed, yaw rate and cost of the cheapest arc; state (5,), goal (2,), obstacles (m, 2).
        The cost is infinite where every arc comes within the radius of an obstacle."""
        best = (0.0, 0.0, math.inf)
        speeds, yaw_rates = self.velocities(state[3], state[4])
        for v in speeds:
            for w in yaw_rates:
                trajectory = self.trajectory(state, v, w)
                cost = (
                    self.heading_gain * self.heading_cost(trajectory, goal)
                    + self.speed_gain * (self.max_speed - trajectory[-1, 3])
                    + self.obstacle_gain * self.obstacle_cost(trajectory, obstacles)
                )
                if cost < best[2]:
                    best = (float(v), float(w), float(cost))
        return best

    def trajectory(self, state: np.ndarray, v: float, w: float) -> np.ndarray:
        """(steps + 1, 5) rows of the state while v and w are held."""
        state = np.array(state)
        trajectory = np.array(state)
        for _ in range(round(self.horizon / self.dt)):
            state = self.motion(state, v, w)
            trajectory = np.vstack((trajectory, state))
        return trajectory

    def motion(self, state: np.ndarray, v: float, w: float) -> np.ndarray:
        moved = np.array(state)
        moved[2] += w * self.dt
        moved[0] += v * math.cos(moved[2]) * self.dt
        moved[1] += v * math.sin(moved[2]) * self.dt
        moved[3], moved[4] = v, w
        return moved

    @staticmethod
    def heading_cost(trajectory: np.ndarray, goal: np.ndarray) -> float:
        dx, dy = goal[0] - trajectory[-1, 0], goal[1] - trajectory[-1, 1]
        error = math.atan2(dy, dx) - trajectory[-1, 2]
        return abs(math.atan2(math.sin(error), math.cos(error)))

    def obstacle_cost(self, trajectory: np.ndarray, obstacles: np.ndarray) -> float:
        dx = trajectory[:, 0] - obstacles[:, 0][:, None]
        dy = trajectory[:, 1] - obstacles[:, 1][:, None]
        nearest = float(np.min(np.hypot(dx, dy)))
        return math.inf if nearest <= self.radius else 1.0 / nearest


def numpy_patch(points: np.ndarray, pose: Pose, config: MapConfig) -> tuple[np.ndarray, np.ndarray]:
    """World points (n, 3) of one scan to a (40, 40) patch of ground heights over the robot's, and where it
    had to be filled: cell by cell the mean of the returns within 0.2 m of the lowest, unknown cells from the
    nearest known, the patch by its nearest cells."""
    x_min, y_min = window_origin(pose.x, pose.y, config)
    size, resolution = config.cells, config.resolution
    col = np.rint((points[:, 0] - x_min) / resolution).astype(int)
    row = np.rint((points[:, 1] - y_min) / resolution).astype(int)
    inside = (row >= 0) & (row < size) & (col >= 0) & (col < size)
    cell, z = row[inside] * size + col[inside], points[inside, 2]
    lowest = np.full(size * size, np.inf)
    np.minimum.at(lowest, cell, z)
    ground = z <= lowest[cell] + 0.2
    count = np.bincount(cell[ground], minlength=size * size)
    total = np.bincount(cell[ground], z[ground], minlength=size * size)
    known = (count > 0).reshape(size, size)
    heights = (total / np.maximum(count, 1)).reshape(size, size)
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled = heights[tuple(np.asarray(nearest))]
    along = (np.arange(PATCH_CELLS) - 0.5 * (PATCH_CELLS - 1)) * PATCH_RESOLUTION
    forward, left = np.meshgrid(along, along)
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    cols = np.rint((pose.x + cos * forward - sin * left - x_min) / resolution).astype(int).clip(0, size - 1)
    rows = np.rint((pose.y + sin * forward + cos * left - y_min) / resolution).astype(int).clip(0, size - 1)
    return filled[rows, cols] - pose.z, ~known[rows, cols]
