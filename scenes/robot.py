"""The Clearpath Husky A200: dimensions and limits (manufacturer's data sheet), metres and radians."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from scenes.pose import Pose


@dataclass(frozen=True)
class Husky:
    """Outer dimensions, drive limits and sensor mounts in the base frame (origin on the ground plane
    between the wheels, x forward, y left, z up)."""

    length: float = 0.990
    width: float = 0.670
    height: float = 0.390
    wheelbase: float = 0.512
    track: float = 0.5708
    max_speed: float = 1.0
    max_reverse_speed: float = 0.3
    max_yaw_rate: float = 1.5
    max_acceleration: float = 3.0
    max_yaw_acceleration: float = 6.0
    max_slope: float = math.radians(22.0)
    max_step: float = 0.15
    max_tilt: float = math.radians(30.0)
    lidar_mount: Pose = field(default_factory=lambda: Pose(0.0, 0.0, 0.75))
    camera_mount: Pose = field(default_factory=lambda: Pose(0.30, 0.0, 0.60))

    @property
    def circumscribed_radius(self) -> float:
        """Radius of the circle about the base that holds the whole body seen from above."""
        return 0.5 * math.hypot(self.length, self.width)

    @property
    def inscribed_radius(self) -> float:
        return 0.5 * self.width

    def hull_points(self) -> np.ndarray:
        """(12, 3) base-frame points on the hull that visibility is measured on: the eight corners of
        the body box (between 0.10 m and the full height) and the centres of its four sides."""
        half_length, half_width = 0.5 * self.length, 0.5 * self.width
        corners = [
            (sx * half_length, sy * half_width, z)
            for sx in (-1, 1)
            for sy in (-1, 1)
            for z in (0.10, self.height)
        ]
        mid = 0.5 * (0.10 + self.height)
        sides = [(half_length, 0, mid), (-half_length, 0, mid), (0, half_width, mid), (0, -half_width, mid)]
        return np.array(corners + sides, dtype=float)


HUSKY = Husky()
