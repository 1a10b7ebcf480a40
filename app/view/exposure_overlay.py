"""The overlay of who sees what: painted on a thread of its own, the newest wish and field win."""

from __future__ import annotations

import asyncio
import logging

import viser

from app.changes import Overlay
from app.exposure_service import Picture
from app.studio import Studio
from app.view.exposure_paint import Paper, Wish, overlay_glb
from app.view.nodes import SwapGlb

log = logging.getLogger(__name__)

STEP = 0.002  # metres by which a new picture lies above the one that it replaces
ROUGH_LINGER_S, LINGER_S = 4.0, 1.0
"""For how long the old one stays: a slow browser takes as long to parse the new one, above which a rough one
that is replaced by a sharp one would be seen."""


class ExposureOverlay:
    """Lives on the studio's loop."""

    def __init__(self, scene: viser.SceneApi, root: str, studio: Studio) -> None:
        self._node = SwapGlb(scene, f"{root}/ground", step=STEP)
        self._studio = studio
        self._paper: Paper | None = None
        self._wanted: tuple[Picture, Wish] | None = None
        self._painting = False

    def open(self, paper: Paper) -> None:
        """Another map: what was drawn goes."""
        self._paper = paper
        self.clear()

    def clear(self) -> None:
        self._wanted = None
        self._node.show(None)

    def draw(self, picture: Picture, wish: Wish) -> None:
        """Show this instead, as soon as it is painted."""
        self._wanted = picture, wish
        if not self._painting:
            self._painting = True
            self._studio.background(self._paint())

    async def _paint(self) -> None:
        try:
            while self._wanted is not None and self._paper is not None:
                wanted, paper, self._wanted = self._wanted, self._paper, None
                try:
                    await self._send(wanted, paper, rough=True)
                    if self._wanted is None and self._up_to_date(wanted[0]):
                        await self._send(wanted, paper, rough=False)
                except Exception:  # what is wanted by now is drawn all the same
                    log.exception("the exposure could not be drawn")
        finally:
            self._painting = False

    async def _send(self, wanted: tuple[Picture, Wish], paper: Paper, rough: bool) -> None:
        (picture, wish), sheet = wanted, (paper.rough or paper) if rough else paper
        mesh = await asyncio.to_thread(overlay_glb, picture.field, wish, sheet)
        if paper is self._paper:
            self._node.show(mesh, ROUGH_LINGER_S if rough else LINGER_S)
            self._studio.show_overlay(Overlay(picture.edits, picture.sharp and not rough))

    def _up_to_date(self, picture: Picture) -> bool:
        return picture.sharp and picture.edits == self._studio.edits
