"""Scene nodes that can be redrawn many times a second: lines, and meshes replaced without a blank."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import numpy as np
import viser

from app.view.tone import for_screen, linear
from scenes.terrain import Heightmap

PARSE_S, OVERLAY_PARSE_S = 0.6, 0.25  # two clear overlays at once look too strong, so they part sooner
SLOTS = 8
_NOWHERE = np.zeros((1, 2, 3), np.float32)


class SwapGlb:
    """A mesh that is replaced by sending the new one beside the old: the browser shows nothing of a GLB
    while it parses it, so the old one is taken away a moment later."""

    def __init__(
        self, scene: viser.SceneApi, name: str, linger_s: float = PARSE_S, step: float = 0.0
    ) -> None:
        """linger_s : for how long the old one stays; step : metres by which the new one lies above it"""
        self._scene, self._name, self._linger_s, self._step = scene, name, linger_s, step
        self._slots: dict[int, viser.GlbHandle] = {}
        self._shown: int | None = None

    def show(self, data: bytes | None, linger_s: float | None = None) -> None:
        """Draw `data` instead of what was drawn, or nothing."""
        old, self._shown = self._shown, None
        if data is not None:
            # few names in turn: viser remembers every name that ever was until somebody connects
            self._shown = 0 if old is None else (old + 1) % SLOTS
            name = f"{self._name}/{self._shown}"
            self._slots[self._shown] = self._scene.add_glb(
                name, data, cast_shadow=False, position=(0.0, 0.0, self._step * self._shown)
            )
        if old is not None and data is None:
            self._remove(old, self._slots[old])
        elif old is not None:
            wait = self._linger_s if linger_s is None else linger_s
            asyncio.get_running_loop().call_later(wait, self._remove, old, self._slots[old])

    def _remove(self, slot: int, handle: viser.GlbHandle) -> None:
        if self._slots.get(slot) is handle:
            del self._slots[slot]
            handle.remove()


class Lines:
    """Line segments that come and go."""

    def __init__(self, scene: viser.SceneApi, name: str, thickness: float) -> None:
        self._handle = scene.add_line_segments(
            name, _NOWHERE, (255, 255, 255), thickness=thickness, visible=False
        )

    def show(self, segments: np.ndarray, colours: np.ndarray | tuple[int, int, int]) -> None:
        """segments : (n, 2, 3) metres; colours : one RGB, or (n, 3) one a segment."""
        if len(segments) == 0:
            self.hide()
            return
        colours = for_screen(np.asarray(colours, np.uint8))
        if colours.ndim == 2:  # viser takes colours of vertices for linear light, a single one for sRGB
            light = np.round(255.0 * linear(colours)).astype(np.uint8)
            colours = np.repeat(light[:, None], 2, axis=1)
        self._handle.points = np.asarray(segments, np.float32)
        self._handle.colors = colours
        self._handle.visible = True

    def hide(self) -> None:
        self._handle.visible = False


def draped(heightmap: Heightmap, xy: np.ndarray, lift: float) -> np.ndarray:
    """Points (..., 2) laid on the ground, (..., 3), `lift` metres above it."""
    return np.concatenate([xy, heightmap.height_at(xy[..., 0], xy[..., 1])[..., None] + lift], axis=-1)


def polyline(points: np.ndarray) -> np.ndarray:
    """(n - 1, 2, 3) segments through (n, 3) points."""
    return np.stack([points[:-1], points[1:]], axis=1)


def resampled(points: np.ndarray, step: float) -> np.ndarray:
    """A polyline (n, 2) with further points so that none is more than `step` metres from the next."""
    pieces = [points[:1]]
    for a, b in pairwise(points):
        count = max(int(np.ceil(np.linalg.norm(b - a) / step)), 1)
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)


def yaw_wxyz(yaw: float) -> tuple[float, float, float, float]:
    """Quaternion (w, x, y, z) of a turn about the vertical, radians."""
    return float(np.cos(0.5 * yaw)), 0.0, 0.0, float(np.sin(0.5 * yaw))
