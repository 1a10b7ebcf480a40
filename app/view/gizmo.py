"""The handles on the selected thing: drag to move it over the ground, turn it about the vertical."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import viser

from app.changes import REFUSALS, Kind, Selection
from app.studio import Studio
from app.view import tools
from app.view.nodes import yaw_wxyz
from scenes.catalogue import CATALOGUE
from scenes.scenario import CoverObject

EDIT_PERIOD_S = 0.06
LIFT = 0.12


class Gizmo:
    """One viewer's gizmo. A drag is one undo entry; a place that is refused is left where it last was
    allowed, and whoever drags is told why when letting go."""

    def __init__(self, studio: Studio, client: viser.ClientHandle, refuse: Callable[[str], None]) -> None:
        self._studio, self._client, self._refuse = studio, client, refuse
        self._handle: viser.TransformControlsHandle | None = None
        self._thing: Selection | None = None
        self._dragging = False
        self._drags = 0
        self._last_edit = 0.0

    def follow(self, thing: Selection | None) -> None:
        """Sit on `thing`, or nowhere; while it is dragged the hand leads."""
        if self._dragging and thing == self._thing:
            return
        if thing != self._thing:
            self._sit_on(thing)
        if self._handle is not None and thing is not None:
            found = self._studio.find(thing)
            ground = float(self._studio.heightmap.height_at(found.x, found.y))
            self._handle.position = (found.x, found.y, ground + LIFT)
            self._handle.wxyz = yaw_wxyz(math.radians(getattr(found, "yaw", 0.0)))

    def _sit_on(self, thing: Selection | None) -> None:
        if self._handle is not None:
            self._handle.remove()
        self._handle, self._thing, self._dragging = None, thing, False
        if thing is None:
            return
        self._handle = self._client.scene.add_transform_controls(
            "/gizmo",
            scale=_reach(self._studio.find(thing)),
            line_width=3.0,
            active_axes=(True, True, False),
            disable_rotations=thing.kind is Kind.GOAL,
            depth_test=False,
            opacity=0.9,
        )

        @self._handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            place = tuple(event.target.position), tuple(event.target.wxyz)
            self._studio.post(self._drag, thing, event.phase, *place, on_error=self._refuse)

    def _drag(self, thing: Selection, phase: str, position: Sequence[float], wxyz: Sequence[float]) -> None:
        if thing != self._thing:
            return
        if not self._dragging:
            self._dragging = True
            self._drags += 1
        try:
            if phase == "end" or time.monotonic() - self._last_edit >= EDIT_PERIOD_S:
                self._last_edit = time.monotonic()
                self._apply(thing, position, wxyz)
        except REFUSALS:
            if phase == "end":
                raise
        finally:
            if phase == "end":
                self._dragging = False
                self.follow(self._studio.selection)

    def _apply(self, thing: Selection, position: Sequence[float], wxyz: Sequence[float]) -> None:
        token = f"gizmo {self._client.client_id} {self._drags}"
        found = self._studio.find(thing)
        x, y = round(float(position[0]), 3), round(float(position[1]), 3)
        yaw = math.degrees(math.remainder(2.0 * math.atan2(wxyz[3], wxyz[0]), math.tau))
        if not np.isfinite([x, y, yaw]).all():
            return
        if math.hypot(x - found.x, y - found.y) > 0.005:
            tools.move(self._studio, thing, x, y, token)
        if thing.kind is not Kind.GOAL and abs(math.remainder(yaw - found.yaw, 360.0)) > 0.1:
            tools.turn(self._studio, thing, yaw, token)


def _reach(thing) -> float:
    if isinstance(thing, CoverObject):
        return max(1.4, 0.75 * thing.footprint.radius / max(CATALOGUE[thing.kind].ground_fraction, 0.3) + 0.9)
    return 1.4
