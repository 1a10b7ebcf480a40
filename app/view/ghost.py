"""A pale, clear Husky under a label: a robot that is not the mission's."""

from __future__ import annotations

import numpy as np
import viser

from app.view import palette
from app.view.glb import Surface, glb, merged
from scenes.husky import husky_visuals
from scenes.pose import Pose

GHOSTLY, ALPHA = 0.6, 235


class Ghost:
    """tint : the colour it is washed with; label_at : metres above its feet; hidden at first"""

    def __init__(
        self, scene: viser.SceneApi, name: str, tint: palette.RGB, label: str = "", label_at: float = 1.1
    ) -> None:
        self._frame = scene.add_frame(name, show_axes=False, visible=False)
        parts = [
            Surface.from_trimesh(part.mesh).moved(part.pose.rotation, part.pose.position)
            for part in husky_visuals().values()
        ]
        body = merged(parts)
        assert body.colours is not None
        pale = np.round((1.0 - GHOSTLY) * body.colours[:, :3] + GHOSTLY * np.array(tint)).astype(np.uint8)
        clear = np.column_stack([pale, np.full(len(pale), ALPHA, np.uint8)])
        ghost = Surface(body.vertices, body.faces, clear, blended=True)
        scene.add_glb(f"{name}/body", glb(ghost), cast_shadow=False)
        self._label = scene.add_label(
            f"{name}/label", label, position=(0.0, 0.0, label_at), anchor="bottom-center"
        )

    def show(self, words: str) -> None:
        if self._label.text != words:
            self._label.text = words
        self._frame.visible = True

    def hide(self) -> None:
        self._frame.visible = False

    def remove(self) -> None:
        """Take it out of the scene for good."""
        self._frame.remove()

    def place(self, pose: Pose) -> None:
        x, y, z, w = pose.quaternion
        self._frame.position = pose.position
        self._frame.wxyz = (w, x, y, z)
