"""Keys for the frequent commands. `static/keys.js` lists the same ones in the page."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import viser

from app.view.layers import STYLES
from app.view.tools import Tool
from planner.frames import Status

if TYPE_CHECKING:
    from app.view.view import StudioView
    from app.view.viewer import Viewer

TOOL_KEYS = {
    "G": Tool.GOAL, "S": Tool.START, "O": Tool.OBSERVER, "C": Tool.COVER, "P": Tool.PATROL,
    "B": Tool.OBSTACLE, "M": Tool.MOVE, "R": Tool.ROTATE, "X": Tool.DELETE, "E": Tool.EXPLAIN,
}  # fmt: skip


def bind_keys(view: StudioView) -> None:
    """Register every key as a command of the viewer's palette."""
    studio = view.studio

    def play_or_pause(_: Viewer) -> None:
        (studio.pause if studio.status is Status.RUNNING else studio.play)()

    commands: list[tuple[str, str, str | None, Callable[[Viewer], None]]] = [
        ("Play or pause", "space", None, play_or_pause),
        ("One step", "N", None, lambda _: studio.step()),
        ("Put down the tool, or deselect", "escape", None, lambda viewer: viewer.disarm_or_deselect()),
        ("Delete the selected thing", "delete", None, lambda viewer: viewer.delete_selected()),
        ("Delete the selected thing (Backspace)", "backspace", None, lambda viewer: viewer.delete_selected()),
        ("Undo", "Z", "cmd/ctrl", lambda _: studio.undo()),
        ("Redo", "Z", "cmd/ctrl+shift", lambda _: studio.redo()),
        ("Redo (Ctrl+Y)", "Y", "cmd/ctrl", lambda _: studio.redo()),
        ("Follow the robot", "F", None, lambda viewer: viewer.follow()),
        ("View from above", "T", None, lambda viewer: viewer.look_from_above()),
        ("Opening view", "H", None, lambda viewer: viewer.look_as_at_first()),
    ]
    for key, tool in TOOL_KEYS.items():
        commands.append((f"Tool: {tool.value}", key, None, lambda viewer, tool=tool: viewer.arm(tool)))
    for layer, style in STYLES.items():
        if style.key is not None:
            commands.append(
                (
                    f"Layer: {style.title}",
                    style.key,
                    None,
                    lambda _, layer=layer: view.show_layer(layer, not view.layers.visible[layer]),
                )
            )
    for label, key, modifier, action in commands:
        _bind(view, label, key, modifier, action)


def _bind(view: StudioView, label: str, key, modifier, action: Callable[[Viewer], None]) -> None:
    command = view.server.gui.add_command(label, hotkey=key, modifier=modifier)

    @command.on_trigger
    async def _(event: viser.CommandEvent) -> None:
        view.for_viewer(event.client_id, action)
