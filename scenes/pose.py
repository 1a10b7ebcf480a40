"""Poses and twists: x east, y north, z up; metres and radians; yaw counter-clockwise from east."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np


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
        x, y, z, w = (float(v) for v in quaternion)
        ahead_x, ahead_y, ahead_z = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)
        level = math.hypot(ahead_x, ahead_y)
        pitch = math.atan2(-ahead_z, level)
        if level > 1e-9:
            yaw = math.atan2(ahead_y, ahead_x)
            roll = math.atan2(2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y))
        else:  # nose straight up or down: yaw and roll turn about one axis, and all of it is called yaw
            yaw = math.atan2(-2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z))
            roll = 0.0
        east, north, up = (float(v) for v in position)
        return cls(east, north, up, roll, pitch, yaw)

    @cached_property
    def position(self) -> np.ndarray:
        """(3,) metres."""
        return np.array([self.x, self.y, self.z])

    @cached_property
    def rotation(self) -> np.ndarray:
        """(3, 3): columns are the body's axes in the world."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    @cached_property
    def rows(self) -> np.ndarray:
        """(3, 3): rows are the body's axes in the world, laid out for fast products with many points."""
        return np.ascontiguousarray(self.rotation.T)

    @cached_property
    def quaternion(self) -> np.ndarray:
        """(4,) as x, y, z, w."""
        cr, sr = math.cos(0.5 * self.roll), math.sin(0.5 * self.roll)
        cp, sp = math.cos(0.5 * self.pitch), math.sin(0.5 * self.pitch)
        cy, sy = math.cos(0.5 * self.yaw), math.sin(0.5 * self.yaw)
        return np.array(
            [
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
                cr * cp * cy + sr * sp * sy,
            ]
        )

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3), or one of (3,), in the body frame, expressed in the world frame."""
        turned = points @ (self.rotation.T if points.ndim == 1 else self.rows)
        for axis in range(3):
            turned[..., axis] += self.position[axis]
        return turned

    def compose(self, pose_body_part: Pose) -> Pose:
        """The world pose of a part that is mounted on this body at `pose_body_part`."""
        ax, ay, az, aw = self.quaternion
        bx, by, bz, bw = pose_body_part.quaternion
        product = (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )
        return Pose.from_quaternion(self.to_world(pose_body_part.position), product)


@dataclass(frozen=True)
class Twist:
    """Planar body velocity: forward speed `v` in m/s, yaw rate `w` in rad/s."""

    v: float = 0.0
    w: float = 0.0


def wrap_angle(angle):
    """Wrap radians to (-pi, pi]; scalars or arrays."""
    return -((-angle + np.pi) % (2.0 * np.pi) - np.pi)
