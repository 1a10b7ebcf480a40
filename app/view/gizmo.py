"""The handles on the selected thing: drag to move it over the ground, turn it about the vertical."""

from __future__ import annotations

import math
import time

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
    """One gizmo for everybody. A drag is one undo entry; a place that is refused is left where it last was
    allowed, and whoever drags is told why when letting go."""

    def __init__(self, studio: Studio, scene: viser.SceneApi, refuse) -> None:
        self._studio, self._scene, self._refuse = studio, scene, refuse
        self._handle: viser.TransformControlsHandle | None = None
        self._thing: Selection | None = None
        self._dragging: int | None = None
        self._drags = 0
        self._last_edit = 0.0

    def follow(self, thing: Selection | None) -> None:
        """Sit on `thing`, or nowhere; between drags only."""
        if self._dragging is not None and thing == self._thing:
            return
        if thing != self._thing or self._handle is None:
            self._sit_on(thing)
        if self._handle is not None and thing is not None:
            found = self._studio.find(thing)
            ground = float(self._studio.heightmap.height_at(found.x, found.y))
            self._handle.position = (found.x, found.y, ground + LIFT)
            self._handle.wxyz = yaw_wxyz(math.radians(getattr(found, "yaw", 0.0)))

    def release(self, client_id: int) -> None:
        """End the drag of a client that has gone."""
        if self._dragging == client_id:
            self._dragging = None
            self.follow(self._studio.selection)

    def _sit_on(self, thing: Selection | None) -> None:
        if self._handle is not None:
            self._handle.remove()
        self._handle, self._thing, self._dragging = None, thing, None
        if thing is None:
            return
        found = self._studio.find(thing)
        self._handle = self._scene.add_transform_controls(
            "/gizmo",
            scale=_reach(found),
            line_width=3.0,
            active_axes=(True, True, False),
            disable_rotations=thing.kind is Kind.GOAL,
            depth_test=False,
            opacity=0.9,
        )

        @self._handle.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            self._studio.post(
                self._drag,
                thing,
                event.client_id,
                event.phase,
                tuple(event.target.position),
                tuple(event.target.wxyz),
            )

    def _drag(self, thing: Selection, client_id: int | None, phase: str, position, wxyz) -> None:
        if thing != self._thing or client_id is None or self._dragging not in (None, client_id):
            return
        if phase == "start" or self._dragging is None:
            self._dragging = client_id
            self._drags += 1
        if phase == "end" or time.monotonic() - self._last_edit >= EDIT_PERIOD_S:
            self._last_edit = time.monotonic()
            self._apply(thing, client_id, phase, position, wxyz)
        if phase == "end":
            self._dragging = None
            self.follow(self._studio.selection)

    def _apply(self, thing: Selection, client_id: int, phase: str, position, wxyz) -> None:
        token = f"gizmo-{self._drags}"
        found = self._studio.find(thing)
        x, y = round(float(position[0]), 3), round(float(position[1]), 3)
        w, _, _, z = wxyz
        yaw = math.degrees(math.remainder(2.0 * math.atan2(z, w), math.tau))
        if not np.isfinite([x, y, yaw]).all():
            return
        try:
            if math.hypot(x - found.x, y - found.y) > 0.005:
                tools.move(self._studio, thing, x, y, token)
            if thing.kind is not Kind.GOAL and abs(math.remainder(yaw - found.yaw, 360.0)) > 0.1:
                tools.turn(self._studio, thing, yaw, token)
        except REFUSALS as error:
            if phase == "end":
                self._refuse(client_id, str(error))


def _reach(thing) -> float:
    if isinstance(thing, CoverObject):
        return max(1.4, 0.75 * thing.footprint.radius / max(CATALOGUE[thing.kind].ground_fraction, 0.3) + 0.9)
    return 1.4
