"""The Husky as it stands and rolls."""

from __future__ import annotations

import math

import numpy as np
import viser

from app.view.glb import Surface, glb, merged
from planner.frames import Frame
from scenes.husky import WHEELS, husky_visuals
from scenes.pose import Pose
from scenes.scenario import Start
from scenes.terrain import Heightmap


class RobotNode:
    """The real meshes under one frame that follows the true pose; the wheels turn about their axles."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        parts = husky_visuals()
        self._frame = scene.add_frame(name, show_axes=False)
        body = [Surface.from_trimesh(part.mesh).moved(part.pose.rotation, part.pose.position)
                for part in parts.values() if not part.wheel]  # fmt: skip
        scene.add_glb(f"{name}/body", glb(merged(body)))
        self._wheels = []
        for wheel in WHEELS:
            part = parts[f"{wheel}_link"]
            mesh = glb(Surface.from_trimesh(part.mesh).moved(part.pose.rotation, np.zeros(3)))
            self._wheels.append(scene.add_glb(f"{name}/{wheel}", mesh, position=part.pose.position))

    def stand(self, start: Start, heightmap: Heightmap) -> None:
        """Wait at the start, before any frame has come."""
        z = float(heightmap.height_at(start.x, start.y))
        self._place(Pose(start.x, start.y, z, yaw=math.radians(start.yaw)))

    def draw(self, frame: Frame) -> None:
        self._place(frame.pose)
        for wheel, angle in zip(self._wheels, frame.wheel_angles, strict=True):
            half = 0.5 * math.remainder(angle, math.tau)
            wheel.wxyz = (math.cos(half), 0.0, math.sin(half), 0.0)

    def _place(self, pose: Pose) -> None:
        x, y, z, w = pose.quaternion
        self._frame.position = pose.position
        self._frame.wxyz = (w, x, y, z)
