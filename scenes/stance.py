"""How a Husky stands on the ground: from its wheels' contact, without physics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from scenes.husky import AXLE_X, AXLE_Y, CHASSIS_BOTTOM, WHEEL_RADIUS, WHEEL_WIDTH
from scenes.pose import Pose
from scenes.robot import HUSKY
from scenes.terrain import Heightmap


def _underside() -> np.ndarray:
    """(n, 3) base-frame points of what may rest on the ground: the wheels' lower rims and the belly."""
    angles = np.linspace(-1.2, 1.2, 9)
    points = [
        (
            sx * AXLE_X + WHEEL_RADIUS * math.sin(angle),
            sy * AXLE_Y + side,
            WHEEL_RADIUS * (1.0 - math.cos(angle)),
        )
        for sx in (-1, 1)
        for sy in (-1, 1)
        for angle in angles
        for side in (-0.5 * WHEEL_WIDTH, 0.0, 0.5 * WHEEL_WIDTH)
    ]
    belly = [
        (x, y, CHASSIS_BOTTOM)
        for x in np.linspace(-0.5 * HUSKY.length, 0.5 * HUSKY.length, 7)
        for y in np.linspace(-AXLE_Y, AXLE_Y, 5)
    ]
    return np.array(points + belly)


UNDERSIDE = _underside()
WHEEL_CONTACTS = np.array([(AXLE_X, AXLE_Y), (AXLE_X, -AXLE_Y), (-AXLE_X, AXLE_Y), (-AXLE_X, -AXLE_Y)])
"""(4, 2) base-frame x, y of the wheels: front left, front right, rear left, rear right."""


def standing_pose(heightmap: Heightmap, x: float, y: float, yaw: float) -> Pose:
    """`pose_world_base` of a Husky at (x, y): tilted as the ground under its four wheels is on average, as
    low as it can be with no part of its underside in the ground."""
    return standing_poses(heightmap, np.array([x]), np.array([y]), np.array([yaw]))[0]


def standing_poses(heightmap: Heightmap, x: np.ndarray, y: np.ndarray, yaw: np.ndarray) -> list[Pose]:
    """`standing_pose` at many places: x, y and yaw (n,)."""
    places = [(float(x), float(y), float(yaw)) for x, y, yaw in zip(x, y, yaw, strict=True)]
    if not places:
        return []
    cos, sin = np.array([(math.cos(yaw), math.sin(yaw)) for *_, yaw in places]).T[..., None]
    ground = heightmap.height_at(
        x[:, None] + cos * WHEEL_CONTACTS[:, 0] - sin * WHEEL_CONTACTS[:, 1],
        y[:, None] + sin * WHEEL_CONTACTS[:, 0] + cos * WHEEL_CONTACTS[:, 1],
    )
    front, rear = ground[:, :2].mean(axis=1), ground[:, 2:].mean(axis=1)
    left, right = ground[:, ::2].mean(axis=1), ground[:, 1::2].mean(axis=1)
    level = []
    for (px, py, heading), rise, bank in zip(places, front - rear, left - right, strict=True):
        pitch = -math.atan2(rise, 2.0 * AXLE_X)
        roll = math.atan2(bank * math.cos(pitch), 2.0 * AXLE_Y)
        level.append(Pose(px, py, 0.0, roll, pitch, heading))
    points = np.stack([pose.to_world(UNDERSIDE) for pose in level])
    z = np.max(heightmap.height_at(points[..., 0], points[..., 1]) - points[..., 2], axis=1)
    return [replace(pose, z=float(height)) for pose, height in zip(level, z, strict=True)]
