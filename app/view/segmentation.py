"""What a method takes the ground for by its looks: a layer over the ground, and the camera's picture."""

from __future__ import annotations

import base64
import io

import numpy as np
import viser
from PIL import Image

from app.view import markup, palette
from app.view.driving import laid
from app.view.glb import Surface, glb
from app.view.ground import coarsened
from app.view.nodes import OVERLAY_PARSE_S, SwapGlb
from planner.frames import Frame, Segmentation
from scenes.catalogue import TraversabilityGroup
from scenes.terrain import Heightmap

PERIOD_S = 0.5
LIFT = 0.06
TINT = 0.5  # share of a group's colour in the camera's picture

WORDS = {
    TraversabilityGroup.BACKGROUND: "background",
    TraversabilityGroup.SMOOTH: "smooth ground",
    TraversabilityGroup.ROUGH: "rough ground",
    TraversabilityGroup.BUMPY: "bumpy ground",
    TraversabilityGroup.FORBIDDEN: "forbidden (water)",
    TraversabilityGroup.OBSTACLE: "obstacle",
}
_COLOURS = np.array([palette.GROUPS[group] for group in TraversabilityGroup], np.uint8)


class GroupsLayer:
    """The groups laid over the ground about the robot, while the method tells any."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        self._node = SwapGlb(scene, f"{root}/ground", OVERLAY_PARSE_S)
        self._ground: Heightmap | None = None
        self._source: Heightmap | None = None
        self._drawn: np.ndarray | None = None
        self._time_s = -np.inf
        self._opacity = 0.75

    def set_opacity(self, opacity: float) -> None:
        self._opacity = opacity
        self._drawn, self._time_s = None, -np.inf

    def draw(self, frame: Frame, heightmap: Heightmap) -> None:
        seen = frame.decision.segmentation if frame.decision is not None else None
        if seen is None:
            self.clear()
            return
        if self._drawn is not None and np.array_equal(seen.ground, self._drawn):
            return
        if abs(frame.time_s - self._time_s) < PERIOD_S:
            return
        if heightmap is not self._source:
            self._source, self._ground = heightmap, coarsened(heightmap)
        assert self._ground is not None
        surface = groups_surface(seen, self._ground, self._opacity)
        self._node.show(None if surface is None else glb(surface))
        self._drawn, self._time_s = seen.ground, frame.time_s

    def clear(self) -> None:
        if self._drawn is not None:
            self._node.show(None)
        self._drawn, self._time_s = None, -np.inf


def groups_surface(seen: Segmentation, ground: Heightmap, opacity: float) -> Surface | None:
    """The drawn ground that has been seen, just above it, in its groups' colours; None where none has."""
    known = seen.ground != Segmentation.UNKNOWN
    rgba = np.zeros((*seen.ground.shape, 4), np.uint8)
    rgba[known, :3] = _COLOURS[seen.ground[known]]
    rgba[known, 3] = round(255 * opacity)
    return laid(rgba, (seen.x_min, seen.y_min), seen.resolution, ground, LIFT)


def picture(seen: Segmentation) -> bytes | None:
    """The camera's image under its groups' colours as a JPEG; None without one."""
    if seen.rgb is None or seen.groups is None:
        return None
    mixed = (1.0 - TINT) * seen.rgb + TINT * _COLOURS[seen.groups]
    with io.BytesIO() as buffer:
        Image.fromarray(np.round(mixed).astype(np.uint8)).save(buffer, "JPEG", quality=85)
        return buffer.getvalue()


def inset(seen: Segmentation | None) -> str:
    """The picture over the upper left of the view, where there is one, and what the groups' colours mean, as
    HTML; empty where no ground is told."""
    if seen is None:
        return ""
    image, words = picture(seen), "What the robot takes its camera's image for"
    shown = ""
    if image is not None:
        address = f"data:image/jpeg;base64,{base64.b64encode(image).decode()}"
        style = "width:100%;display:block;border-radius:4px;margin-bottom:6px"
        shown = f'<img alt="{words}" title="{words}" src="{address}" style="{style}">'
    box = (
        "position:fixed;left:14px;top:14px;width:212px;z-index:5;pointer-events:none;border-radius:8px;"
        "padding:8px;background:rgba(26,27,30,.86);font-size:11.5px;line-height:1.45;color:#e8e8e8"
    )
    keys = "".join(markup.chip(palette.GROUPS[group], word) for group, word in WORDS.items())
    return f'<div id="camera-inset" style="{box}">{shown}{keys}</div>'


def legend() -> str:
    """What the groups' colours mean."""
    return "".join(markup.key(palette.GROUPS[group], word, height=8) for group, word in WORDS.items())
