"""Poses and twists: x east, y north, z up; metres and radians; yaw counter-clockwise from east."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Pose:
    """A rigid pose of a body in the world frame (intrinsic z-y-x: yaw, then pitch, then roll)."""

    x: float
    y: float
    z: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @classmethod
    def from_quaternion(cls, position, quaternion) -> Pose:
        """Build from a position (3,) and an (x, y, z, w) unit quaternion."""
        yaw, pitch, roll = Rotation.from_quat(quaternion).as_euler("ZYX")
        x, y, z = (float(v) for v in position)
        return cls(x, y, z, float(roll), float(pitch), float(yaw))

    @cached_property
    def position(self) -> np.ndarray:
        """(3,) metres."""
        return np.array([self.x, self.y, self.z])

    @cached_property
    def rotation(self) -> np.ndarray:
        """(3, 3): columns are the body's axes in the world."""
        return Rotation.from_euler("ZYX", [self.yaw, self.pitch, self.roll]).as_matrix()

    @cached_property
    def quaternion(self) -> np.ndarray:
        """(4,) as x, y, z, w."""
        return Rotation.from_euler("ZYX", [self.yaw, self.pitch, self.roll]).as_quat()

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) in the body frame, expressed in the world frame."""
        return points @ self.rotation.T + self.position

    def compose(self, pose_body_part: Pose) -> Pose:
        """The world pose of a part that is mounted on this body at `pose_body_part`."""
        rotation = Rotation.from_matrix(self.rotation @ pose_body_part.rotation)
        return Pose.from_quaternion(
            self.to_world(pose_body_part.position[None])[0], rotation.as_quat()
        )


@dataclass(frozen=True)
class Twist:
    """Planar body velocity: forward speed `v` in m/s, yaw rate `w` in rad/s."""

    v: float = 0.0
    w: float = 0.0


def wrap_angle(angle):
    """Wrap radians to (-pi, pi]; scalars or arrays."""
    return -((-angle + np.pi) % (2.0 * np.pi) - np.pi)
