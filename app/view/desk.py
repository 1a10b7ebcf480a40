"""The way from a viewer's widgets to the studio's commands, shared by the panel's tabs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import viser

if TYPE_CHECKING:
    from app.view.viewer import Viewer


class Desk:
    """One viewer's widgets; what they do is posted, and refused to that viewer alone."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer, self.studio, self.gui = viewer, viewer.studio, viewer.client.gui

    def post(self, command: Callable, *args: Any, **named: Any) -> None:
        """From any thread: run a command on the studio's loop; a refusal is shown to this viewer."""
        self.studio.post(command, *args, on_error=self._refuse, **named)

    def _refuse(self, reason: str) -> None:
        self.viewer.refuse(reason)

    def on_click(self, button: Any, command: Callable, *args: Any) -> None:
        @button.on_click
        async def _(_: viser.GuiEvent) -> None:
            self.post(command, *args)

    def on_choice(self, group: Any, commands: dict[str, Callable[[], Any]]) -> None:
        """A row of buttons: each label with what it does."""

        @group.on_click
        async def _(event: viser.GuiEvent) -> None:
            command = commands.get(event.target.value)
            if command is not None:
                self.post(command)

    def on_value(self, handle: Any, command: Callable[[Any], Any]) -> None:
        """What a person enters; values that we set ourselves come without a client and are left alone."""

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self.post(command, event.target.value)

    def progress(self, title: str, words: str) -> viser.NotificationHandle:
        """A note that stays until it is removed, for what takes longer than a moment."""
        return self.viewer.client.add_notification(title, words, loading=True, with_close_button=False)


def show_value(handle: Any, value: Any) -> None:
    """Show a value without disturbing a person who has just entered the same."""
    if handle.value != value:
        handle.value = value
