"""What Bullet itself sees of a world, for comparison with `scenes.rays` and `scenes.sensors`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from scenes.pose import Pose

RAY_BATCH = 8192  # rayTestBatch answers one ray too few for exactly 16,384


class BulletEyes:
    """Of the world behind `client`; `labels` in `RayScene.bodies` by Bullet's body id. What has none (walls,
    the robot) counts as a miss."""

    def __init__(self, client: Any, labels: Mapping[int, int]) -> None:
        self._bullet, self._labels = client, labels

    def cast_rays(
        self, origins: np.ndarray, directions: np.ndarray, max_range: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The first hit along rays (n, 3), directions of unit length, by Bullet's batched ray test: distance
        (n,) float32, inf for a miss, and label (n,) int32, -1 for a miss."""
        origins = np.broadcast_to(np.asarray(origins, float), np.shape(directions))
        ends = origins + max_range * np.asarray(directions, float)
        answers = []
        for begin in range(0, len(ends), RAY_BATCH):
            batch = slice(begin, begin + RAY_BATCH)
            answers += self._bullet.rayTestBatch(origins[batch].tolist(), ends[batch].tolist(), numThreads=1)
        body = np.array([self._labels.get(answer[0], -1) for answer in answers], np.int32)
        share = np.array([answer[2] for answer in answers], np.float32)
        return np.where(body >= 0, share * np.float32(max_range), np.float32(np.inf)), body

    def render_segmentation(
        self, pose_world_camera: Pose, width: int, height: int, fov_horizontal: float, max_range: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bullet's software renderer, in a world with `cover_meshes`: depth (height, width) float32 along the
        optical axis, inf where nothing is, and labels (height, width) int32, -1 where nothing is."""
        near = 0.05
        rotation = pose_world_camera.rotation
        eye = pose_world_camera.position
        fov_vertical = 2.0 * math.atan(math.tan(0.5 * fov_horizontal) * height / width)
        _, _, _, buffer, segments = self._bullet.getCameraImage(
            width,
            height,
            viewMatrix=self._bullet.computeViewMatrix(eye, eye + rotation[:, 0], rotation[:, 2]),
            projectionMatrix=self._bullet.computeProjectionMatrixFOV(
                math.degrees(fov_vertical), width / height, near, max_range
            ),
            shadow=0,
            renderer=self._bullet.ER_TINY_RENDERER,
        )
        buffer = np.reshape(buffer, (height, width)).astype(float)
        depth = max_range * near / (max_range - (max_range - near) * buffer)
        table = np.full(max(self._labels) + 2, -1, np.int32)
        for body, label in self._labels.items():
            table[body] = label
        segments = np.reshape(segments, (height, width))
        known = (segments >= 0) & (segments < len(table) - 1) & (depth <= max_range)
        body = np.where(known, table[segments.clip(-1, len(table) - 1)], -1)
        return np.where(body >= 0, depth, np.inf).astype(np.float32), body.astype(np.int32)
