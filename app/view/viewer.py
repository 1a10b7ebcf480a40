"""One person who looks: their tool, their camera, their panel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import viser

from app.changes import Change, StudioError
from app.view import tools
from app.view.camera import Eye, Viewpoint, top_view
from app.view.gizmo import Gizmo
from app.view.panel import Panel
from app.view.picking import Pick
from app.view.tools import Armed, Tool
from scenes.pose import Pose

if TYPE_CHECKING:
    from app.view.view import StudioView

REFUSAL_S = 6.0


class Viewer:
    """Lives on the studio's loop, from a browser's first camera to its going."""

    def __init__(self, view: StudioView, client: viser.ClientHandle) -> None:
        self.view, self.client, self.studio = view, client, view.studio
        self.armed = Armed()
        self.eye = Eye(client)
        self.gizmo = Gizmo(self.studio, client, self.refuse)
        self.panel = Panel(self)
        self._hold()

    def arm(self, tool: Tool | None) -> None:
        """Hold a tool; the one already held is put down."""
        self.armed.tool = None if tool is self.armed.tool else tool
        self.panel.refresh_tool()
        self._hold()

    def _hold(self) -> None:
        """Handles on the selected thing, but out of the way of a tool that places."""
        free = self.armed.tool in (None, Tool.MOVE, Tool.ROTATE)
        self.gizmo.follow(self.studio.selection if free else None)

    def disarm_or_deselect(self) -> None:
        if self.armed.tool is not None:
            self.arm(None)
        else:
            self.studio.select(None)

    def click(self, origin: Sequence[float], direction: Sequence[float]) -> None:
        """A click whose ray goes from `origin` along `direction`, world frame."""
        studio = self.studio
        try:
            pick = self.view.picker.pick(origin, direction, studio.scenario, studio.heightmap, studio.frame)
        except ValueError:
            return  # a ray that no mouse makes
        if self._means_exposure(pick):
            return
        tools.click(studio, self.armed, pick)

    def _means_exposure(self, pick: Pick) -> bool:
        """Whether a click asks for a place to be explained, or for a compared route to be followed."""
        exposure = self.view.exposure
        if self.armed.tool is Tool.EXPLAIN and pick.point is not None:
            self.studio.background(self._explain(*pick.point))
            return True
        if self.armed.tool is None and pick.thing is None and pick.point is not None:
            route = exposure.route_at(*pick.point)
            if route is not None:
                exposure.follow(route)
                return True
        return False

    async def _explain(self, x: float, y: float) -> None:
        try:
            await self.view.exposure.explain(x, y)
        except StudioError as error:
            self.refuse(str(error))

    def delete_selected(self) -> None:
        if self.studio.selection is not None:
            self.studio.remove(self.studio.selection)

    def follow(self) -> None:
        self.eye.toggle_follow(self._robot_pose())

    def look_from_above(self) -> None:
        self.eye.toggle_top(top_view(self.studio.heightmap, (0.0, 0.0)))

    def look_as_at_first(self) -> None:
        self.eye.opening(self.view.opening_view())

    def look_at_learner(self) -> None:
        """Look at the robot of the training from behind and above, wherever its ground is."""
        robot = self.view.training.robot
        self.eye.opening(Viewpoint(robot + np.array([-9.0, -9.0, 9.0]), robot))

    def _robot_pose(self) -> Pose:
        if self.studio.frame is not None:
            return self.studio.frame.pose
        start = self.studio.scenario.start
        return Pose(start.x, start.y, float(self.studio.heightmap.height_at(start.x, start.y)))

    def refuse(self, reason: str) -> None:
        """Say why something was not done: in the view, and in the page beside the pointer."""
        sentence = reason[:1].upper() + reason[1:]
        self.panel.tell_refusal(sentence)
        self.client.add_notification("Not done", sentence, color="orange", auto_close_seconds=REFUSAL_S)

    def refresh(self, change: Change) -> None:
        self.panel.refresh(change)
        if change in (Change.SELECTED, Change.EDITED, Change.OPENED):
            self._hold()

    def refresh_layers(self) -> None:
        self.panel.refresh_layers()
