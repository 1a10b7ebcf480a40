"""The robot's rolling map: ground height with its variance, what stands on the ground, what hangs over it.

Cells are aligned with the world: cell centres lie at whole multiples of the resolution, in whatever window
about the robot, so that rolling the window moves numbers and changes none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from planner import elevation_kernels as kernels
from planner.elevation_clearing import clear_seen_through
from planner.frames import GridMap
from planner.ground_segmentation import Scan, segment
from scenes.pose import Pose
from scenes.robot import HUSKY

ROLL = 1.0
"""Metres: the window follows the robot in steps of this size."""

PATCH_CELLS, PATCH_RESOLUTION = 40, 0.5
"""The patch that the learned methods see, after TERP (Weerakoon et al. 2022)."""


@dataclass(frozen=True)
class MapConfig:
    """Sizes in metres.

    clearance : what hangs higher than this over the ground does not block the robot
    max_gap : cells; longer gaps between measured cells stay unknown
    contact_sigma : how well the robot's own stance tells the ground under it
    """

    size: float = 40.0
    resolution: float = 0.2
    clearance: float = HUSKY.height + 0.2
    max_step: float = HUSKY.max_step
    max_slope: float = HUSKY.max_slope
    max_gap: int = 3
    contact_sigma: float = 0.03

    @property
    def cells(self) -> int:
        """Cells along a side; odd, so that the window has a middle cell."""
        return 2 * round(0.5 * self.size / self.resolution) + 1


def window_origin(x: float, y: float, config: MapConfig) -> tuple[float, float]:
    """(x_min, y_min), the centre of cell [0, 0], of the window about a robot at (x, y)."""
    roll = max(round(ROLL / config.resolution), 1)
    half = config.cells // 2
    row = round(y / config.resolution / roll) * roll - half
    col = round(x / config.resolution / roll) * roll - half
    return col * config.resolution, row * config.resolution


def step_cells(elevation: np.ndarray, config: MapConfig) -> np.ndarray:
    """(rows, cols) bool: the upper side of every step that is too high for the wheels.

    A step is a rise between cells one or two apart, beyond what the steepest drivable slope explains."""
    rise = math.tan(config.max_slope) * config.resolution
    return kernels.steps(np.asarray(elevation, float), config.max_step, rise)


def elevation_patch(grid: GridMap, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """The grid about the robot in its own heading, for the learned methods.

    Returns (40, 40) float32 ground height minus the robot's, axis 0 along +y (left) and axis 1 along +x
    (forward) of the body, cells of 0.5 m centred at -9.75 to 9.75 m; and (40, 40) bool, where the grid knew
    nothing and the nearest known cell stands in.
    """
    height = kernels.turned_patch(
        grid.elevation, grid.x_min, grid.y_min, grid.resolution,
        pose.x, pose.y, pose.yaw, PATCH_CELLS, PATCH_RESOLUTION,
    )  # fmt: skip
    unknown = np.isnan(height)
    if unknown.all():
        return np.zeros((PATCH_CELLS, PATCH_CELLS), np.float32), unknown
    return (without_gaps(height) - pose.z).astype(np.float32), unknown


def without_gaps(heights: np.ndarray) -> np.ndarray:
    """Heights (rows, cols) with the nearest known one where they are unknown (NaN); 0 where none is known."""
    unknown = np.isnan(heights)
    if unknown.all():
        return np.zeros_like(heights)
    nearest = np.asarray(distance_transform_edt(unknown, return_distances=False, return_indices=True))
    return heights[nearest[0], nearest[1]]


class ElevationMap:
    """Fuses scans into the window about the robot.

    Ground is kept apart from what stands on it and from what hangs above the robot (a tree's crown), which
    neither raises the ground nor blocks; water blocks where a camera has told it. What later scans look
    through fades; what leaves the window is forgotten. The lowest beam of a VLP-16 meets flat ground 2.8 m
    away: nearer cells are unknown until the robot has come by, except those it stands on and those that a
    depth image shows.
    """

    def __init__(self, x: float, y: float, config: MapConfig | None = None):
        self.config = config or MapConfig()
        self.x_min, self.y_min = window_origin(x, y, self.config)
        self.turn = 0
        self._cells = kernels.empty_cells(self.config.cells, self.config.cells)

    def move_to(self, x: float, y: float) -> None:
        """Roll the window by whole cells so that the robot at (x, y) is near its middle."""
        x_min, y_min = window_origin(x, y, self.config)
        by_col = round((x_min - self.x_min) / self.config.resolution)
        by_row = round((y_min - self.y_min) / self.config.resolution)
        if by_col == by_row == 0:
            return
        old, size = self._cells, self.config.cells
        self._cells = kernels.empty_cells(size, size)
        if abs(by_row) < size and abs(by_col) < size:
            to_row, from_row = _overlap(by_row, size)
            to_col, from_col = _overlap(by_col, size)
            self._cells[:, to_row, to_col] = old[:, from_row, from_col]
        self.x_min, self.y_min = x_min, y_min

    def stand_at(self, pose: Pose) -> None:
        """The robot stands at `pose`: the ground under its wheels is known, and nothing else is there.

        A robot that has tipped over tells nothing."""
        up = pose.rotation[:, 2]
        if up[2] < math.cos(2.0 * HUSKY.max_slope):
            return
        kernels.stand(
            self._cells, pose.position, np.array([math.cos(pose.yaw), math.sin(pose.yaw)]), up,
            0.5 * np.array([HUSKY.length, HUSKY.width]), self.x_min, self.y_min, self.config.resolution,
            1.0 / self.config.contact_sigma**2,
        )  # fmt: skip

    def add_scan(self, scan: Scan, pose_world_base: Pose) -> None:
        """Fuse one scan, taken by a robot that stands at `pose_world_base`; a lidar's also clears."""
        self.turn += 1
        labels, expected, distance = segment(scan, pose_world_base)
        wet = np.zeros((0, 0), bool) if scan.wet is None else scan.wet
        place = (self.x_min, self.y_min, self.config.resolution)
        kernels.fuse(
            self._cells, scan.points, labels, expected, distance, wet, *place,
            scan.range_sigma, self.config.clearance, float(self.turn),
        )  # fmt: skip
        if scan.elevations is not None:
            sensor = scan.pose_world_sensor
            clear_seen_through(
                self._cells, distance, labels, scan.elevations, sensor.position, sensor.rotation,
                *place, float(self.turn),
            )  # fmt: skip

    def grid(self) -> GridMap:
        """The map as planners read it: small gaps filled, obstacles judged over the ground as now known."""
        mean, spread = kernels.measured_ground(self._cells)
        elevation, variance = kernels.fill_gaps(mean, spread, self.config.resolution, self.config.max_gap)
        blocked, overhang, span = kernels.standing_things(
            self._cells, elevation, self.config.clearance, self.config.max_step
        )
        return GridMap(
            self.x_min,
            self.y_min,
            self.config.resolution,
            elevation.astype(np.float32),
            variance.astype(np.float32),
            blocked | step_cells(mean, self.config),
            overhang,
            span,
        )

    def patch(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """`elevation_patch` of the present grid."""
        return elevation_patch(self.grid(), pose)

    @property
    def extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest return from the ground of each cell, (rows, cols) metres, NaN where none was."""
        return self._cells[kernels.LOWEST].copy(), self._cells[kernels.HIGHEST].copy()


def _overlap(shift: int, size: int) -> tuple[slice, slice]:
    """Where the cells that stay are put, and where they are taken from."""
    if shift >= 0:
        return slice(0, size - shift), slice(shift, size)
    return slice(-shift, size), slice(0, size + shift)
