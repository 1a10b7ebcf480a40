"""Small maps and percepts made by hand."""

import math

import numpy as np

from planner.frames import GridMap, Percept, Perception
from planner.perception import nearest_points, obstacle_distances, obstacle_points
from scenes.pose import Pose, Twist

HALF = 8.0
STILL = Twist()


def grid_map(height=lambda x, y: 0.0 * x, blocked=lambda x, y: False, unknown=lambda x, y: False) -> GridMap:
    """16 m square at 0.2 m about the origin, from functions of world x and y."""
    along = np.arange(-HALF, HALF + 0.1, 0.2)
    x, y = np.meshgrid(along, along)
    elevation = np.asarray(height(x, y) + 0.0 * x, np.float32)
    elevation[unknown(x, y) & np.ones_like(x, bool)] = np.nan
    return GridMap(
        -HALF, -HALF, 0.2, elevation, np.zeros_like(elevation),
        blocked(x, y) & np.ones_like(x, bool), np.full_like(elevation, np.inf),
        np.stack([np.full_like(elevation, np.inf), np.full_like(elevation, -np.inf)]),
    )  # fmt: skip


def percept(
    grid: GridMap, pose: Pose, goal=(6.0, 0.0), twist: Twist = STILL, time_s: float = 0.0, moving=()
) -> Percept:
    points = obstacle_points(grid)
    return Percept(
        time_s, Perception.LIDAR, pose, twist, goal, grid,
        np.zeros((40, 40), np.float32), np.zeros((40, 40), bool),
        nearest_points(points, pose), obstacle_distances(points, pose), moving,
    )  # fmt: skip


def moved(pose: Pose, twist: Twist, seconds: float = 0.1) -> Pose:
    """Where a robot that follows its command exactly is after a tick."""
    middle = pose.yaw + 0.5 * twist.w * seconds
    return Pose(
        pose.x + twist.v * seconds * math.cos(middle),
        pose.y + twist.v * seconds * math.sin(middle),
        0.0,
        yaw=pose.yaw + twist.w * seconds,
    )


def drive(decide, grid: GridMap, pose: Pose, goal=(6.0, 0.0), ticks: int = 400, moving=lambda time_s: ()):
    """Let `decide` drive a robot that follows exactly: [(percept, decided)] until the goal is reached."""
    log, twist = [], Twist()
    for tick in range(ticks):
        now = percept(grid, pose, goal, twist, 0.1 * tick, moving(0.1 * tick))
        if now.goal_distance < 0.3 and abs(twist.v) < 0.1:
            break
        decided = decide(now)
        log.append((now, decided))
        if getattr(decided, "failure", None) or getattr(decided, "stuck", False):
            break
        twist = decided.command
        pose = moved(pose, twist)
    return log
