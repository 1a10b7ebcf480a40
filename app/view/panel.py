"""The control panel of one viewer: tabs by what a person wants, every action posted to the studio."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

from app.changes import Change
from app.view import markup, segmentation
from app.view.desk import Desk
from app.view.layers import Layer
from app.view.panel_drive import DriveTab
from app.view.panel_exposure import ExposureTab
from app.view.panel_layers import LayersTab
from app.view.panel_plan import PlanTab
from app.view.panel_replay import ReplayFolder
from app.view.panel_scenarios import ScenariosTab
from app.view.panel_training import TrainingTab
from app.view.tools import HINTS

if TYPE_CHECKING:
    from app.view.viewer import Viewer


class Panel:
    """The tabs Plan, Drive, Exposure, Train, Layers and Scenes under a line that says which tool is held."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._refusal, self._refusals = "", 0
        desk = Desk(viewer)
        self._held = desk.gui.add_html("")
        self._inset, self._seen = desk.gui.add_html(""), ""
        self.replay = ReplayFolder(desk)
        tabs = desk.gui.add_tab_group()
        with tabs.add_tab("Plan"):
            self.plan = PlanTab(desk)
        with tabs.add_tab("Drive"):
            self.drive = DriveTab(desk)
        with tabs.add_tab("Exposure"):
            self.exposure = ExposureTab(desk)
        with tabs.add_tab("Train"):
            self.training = TrainingTab(desk)
        with tabs.add_tab("Layers"):
            self.layers = LayersTab(desk)
        with tabs.add_tab("Scenes"):
            self.scenarios = ScenariosTab(desk)
        self.refresh_tool()

    def refresh_tool(self) -> None:
        self.plan.refresh_tool()
        self._say()

    def tell_refusal(self, reason: str) -> None:
        """Let the page around the view say it at the pointer."""
        self._refusals += 1
        self._refusal = reason
        self._say()

    def _say(self) -> None:
        tool = self._viewer.armed.tool
        hint = HINTS[tool] if tool is not None else ""
        visible = self._viewer.view.layers.visible
        told = {
            "tool": tool.value if tool is not None else "",
            "hint": hint,
            "layers": " ".join(layer.value for layer in visible if visible[layer]),
            "refusal": self._refusal,
            "refusals": str(self._refusals),
        }
        data = "".join(f' data-{name}="{html.escape(value)}"' for name, value in told.items())
        self._held.content = (
            f'<div id="covernav-state"{data}>{markup.note(hint, "Esc to stop") if hint else ""}</div>'
        )

    def _show_camera(self) -> None:
        """The camera's image with what the method takes it for, while it tells."""
        view, frame = self._viewer.view, self._viewer.studio.frame
        decision = None if frame is None or not view.layers.visible[Layer.GROUPS] else frame.decision
        shown = segmentation.inset(None if decision is None else decision.segmentation)
        if shown != self._seen:
            self._inset.content = self._seen = shown

    def refresh_layers(self) -> None:
        self._show_camera()
        self.layers.refresh()
        self.refresh_tool()

    def refresh(self, change: Change) -> None:
        """Show what has changed."""
        if change in (Change.FRAME, Change.OPENED, Change.SETTINGS, Change.STATUS):
            self._show_camera()
        if change in (Change.TRAINING, Change.OPENED, Change.SETTINGS):
            self.training.refresh()
        if change is Change.TRAINING:
            return
        if change in (Change.SELECTED, Change.EDITED, Change.OPENED):
            self.plan.refresh()
        if change not in (Change.SELECTED, Change.EXPOSURE, Change.OVERLAY, Change.ROUTES):
            self.drive.refresh(change)
        if change is not Change.OVERLAY:
            self.exposure.refresh(change)
        if change in (Change.OPENED, Change.LIBRARY, Change.EDITED, Change.SETTINGS):
            self.scenarios.refresh(change)
