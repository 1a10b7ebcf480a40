"""The control panel of one viewer: tabs by what a person wants, every action posted to the studio."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import viser

from app.changes import Change
from app.view.desk import Desk
from app.view.panel_drive import DriveTab
from app.view.panel_layers import LayersTab
from app.view.panel_plan import PlanTab
from app.view.panel_scenarios import ScenariosTab
from app.view.tools import HINTS

if TYPE_CHECKING:
    from app.view.viewer import Viewer


class Panel:
    """The tabs Plan, Drive, Layers and Scenarios under a line that says which tool is held."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        desk = Desk(viewer)
        self._held = desk.gui.add_html("")
        tabs = desk.gui.add_tab_group()
        with tabs.add_tab("Plan", viser.Icon.PENCIL):
            self.plan = PlanTab(desk)
        with tabs.add_tab("Drive", viser.Icon.STEERING_WHEEL):
            self.drive = DriveTab(desk)
        with tabs.add_tab("Layers", viser.Icon.STACK_2):
            self.layers = LayersTab(desk)
        with tabs.add_tab("Scenes", viser.Icon.MAP_2):
            self.scenarios = ScenariosTab(desk)
        self.refresh_tool()

    def refresh_tool(self) -> None:
        tool = self._viewer.armed.tool
        self.plan.refresh_tool()
        self._held.content = _state_line(
            tool.value if tool is not None else "",
            HINTS[tool] if tool is not None else "",
            [layer.value for layer, visible in self._viewer.view.layers.visible.items() if visible],
        )

    def refresh_layers(self) -> None:
        self.layers.refresh()
        self.refresh_tool()

    def refresh(self, change: Change) -> None:
        """Show what has changed."""
        if change in (Change.SELECTED, Change.EDITED, Change.OPENED):
            self.plan.refresh()
        if change is not Change.SELECTED:
            self.drive.refresh(change)
        if change in (Change.OPENED, Change.LIBRARY, Change.EDITED, Change.SETTINGS):
            self.scenarios.refresh(change)


def _state_line(tool: str, hint: str, layers: list[str]) -> str:
    """The held tool for people, and for the page around the view, which shows it beside the pointer."""
    shown = (
        f'<div style="padding:7px 12px;margin:0 8px 4px;border-radius:6px;background:rgba(38,160,150,.22);'
        f'font-size:12.5px;color:#d6f2ee">{html.escape(hint)} · <b>Esc</b> to stop</div>'
        if tool else ""
    )  # fmt: skip
    return (
        f'<div id="covernav-state" data-tool="{html.escape(tool)}" data-hint="{html.escape(hint)}"'
        f' data-layers="{" ".join(layers)}">{shown}</div>'
    )
