"""Where the robot would meet those who walk or drive about, if it set off for there now."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.foresight import Foresight
from planner.frames import Percept, TrackedObstacle
from planner.pace import seconds_to
from planner.tracking import outline_discs
from scenes.robot import HUSKY

AHEAD = np.arange(0.0, 6.5, 0.5)
"""Seconds from now at which they are looked for."""

REACH = 6.0
"""Metres about the robot within which it is worth while."""

ROOM, FADING = 0.4, 0.8
"""Metres between the robot's outline and theirs that are a meeting, and over which the chance then falls to
nothing: neither keeps to its way exactly."""

UNSURE = (0.8, 0.25)
"""Standard deviation of the arrival: seconds, and a share of the seconds till then."""


def meeting_chance(percept: Percept, foresight: Foresight) -> np.ndarray:
    """(rows, cols) float over `percept.grid`, from 0 to 1: the chance that one of the tracked obstacles is at
    a cell when the robot comes there, 0 farther than `REACH`."""
    grid, pose = percept.grid, percept.pose
    chance = np.zeros(grid.shape)
    if not percept.moving:
        return chance
    window, x, y = _about(percept)
    arrival = seconds_to(pose, x, y)
    sigma = UNSURE[0] + UNSURE[1] * arrival
    timely = np.exp(-0.5 * ((AHEAD[:, None] - arrival) / sigma) ** 2)
    timely[:, arrival > AHEAD[-1]] = 0.0
    free = np.ones(len(x))
    for one in percept.moving:
        poses = foresight(one, _track(percept, one), (percept.time_s + AHEAD).tolist())
        free *= 1.0 - (timely * _there(one, poses, x, y)).max(axis=0)
    block = chance[window]
    block[:] = (1.0 - free).reshape(block.shape)
    block[np.hypot(x - pose.x, y - pose.y).reshape(block.shape) > REACH] = 0.0
    return chance


def _track(percept: Percept, obstacle: TrackedObstacle) -> np.ndarray:
    now = (percept.time_s, obstacle.x, obstacle.y, obstacle.vx, obstacle.vy)
    return percept.tracks.get(obstacle.object_id, np.array([now]))


def _about(percept: Percept) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
    """The part of the grid within reach, and world x and y (n,) of its cells."""
    grid = percept.grid
    row, col = grid.cell(percept.pose.x, percept.pose.y)
    cells = math.ceil(REACH / grid.resolution)
    rows = slice(max(row - cells, 0), min(row + cells + 1, grid.shape[0]))
    cols = slice(max(col - cells, 0), min(col + cells + 1, grid.shape[1]))
    y, x = np.mgrid[rows, cols] * grid.resolution
    return (rows, cols), (x + grid.x_min).ravel(), (y + grid.y_min).ravel()


def _there(obstacle: TrackedObstacle, poses: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(times, n) chance that an obstacle of poses (times, ways, 3) is near places (n,)."""
    near = np.zeros((len(poses), len(x)))
    speed = max(math.hypot(obstacle.vx, obstacle.vy), 1e-6)
    for time, ways in enumerate(poses):
        kinds, counts = np.unique(np.round(ways, 1), axis=0, return_counts=True)
        for (at_x, at_y, heading), count in zip(kinds.tolist(), counts.tolist(), strict=True):
            turned = replace(
                obstacle, x=at_x, y=at_y, vx=speed * math.cos(heading), vy=speed * math.sin(heading)
            )
            gap = np.full(len(x), np.inf)
            for disc_x, disc_y, radius in outline_discs(turned):
                gap = np.minimum(gap, np.hypot(x - disc_x, y - disc_y) - radius)
            beyond = (gap - HUSKY.inscribed_radius - ROOM) / FADING
            near[time] += count / len(ways) * np.clip(1.0 - beyond, 0.0, 1.0)
    return near
