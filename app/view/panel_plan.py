"""Plan: the tools, and the properties of what is selected."""

from __future__ import annotations

import time
from typing import Any

from app.changes import Kind, Selection
from app.view import tools
from app.view.desk import Desk, show_value
from app.view.properties import FIELDS, Field, shown_value
from app.view.tools import Tool
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.scenario import ObstacleKind

PAUSE_S = 1.5
ROWS: tuple[tuple[str, dict[str, Tool]], ...] = (
    ("Drive", {"Goal": Tool.GOAL, "Start": Tool.START, "Robot": Tool.ROBOT}),
    ("Place", {"Observer": Tool.OBSERVER, "Cover": Tool.COVER, "Walker": Tool.OBSTACLE}),
    ("Change", {"Move": Tool.MOVE, "Rotate": Tool.ROTATE, "Delete": Tool.DELETE}),
)


class PlanTab:
    def __init__(self, desk: Desk) -> None:
        self._desk, self._gui, self._studio = desk, desk.gui, desk.studio
        viewer, armed = desk.viewer, desk.viewer.armed
        for label, row in ROWS:
            group = self._gui.add_button_group(label, tuple(row))
            desk.on_choice(group, {name: (lambda tool=tool: viewer.arm(tool)) for name, tool in row.items()})
        self._cover_kind = self._gui.add_dropdown(
            "Cover class",
            tuple(entry.class_name for entry in CATALOGUE.values()),
            initial_value=CATALOGUE[armed.cover].class_name,
        )
        desk.on_value(self._cover_kind, self._choose_cover)
        self._walker_kind = self._gui.add_dropdown(
            "Who moves", tuple(ObstacleKind), initial_value=armed.obstacle
        )
        desk.on_value(self._walker_kind, self._choose_walker)
        edits = self._gui.add_button_group("History", ("Undo", "Redo"))
        desk.on_choice(edits, {"Undo": self._studio.undo, "Redo": self._studio.redo})
        self._folder: Any = None
        self._held: Selection | None = None
        self._shape: object = None
        self._widgets: dict[str, Any] = {}
        self._entries, self._entered_at = 0, 0.0
        self.refresh()

    def _choose_cover(self, class_name: str) -> None:
        kinds = {entry.class_name: kind for kind, entry in CATALOGUE.items()}
        if class_name in kinds:
            self._desk.viewer.armed.cover = CoverKind(kinds[class_name])

    def _choose_walker(self, kind: str) -> None:
        if kind in set(ObstacleKind):
            self._desk.viewer.armed.obstacle = ObstacleKind(kind)

    def refresh_tool(self) -> None:
        tool = self._desk.viewer.armed.tool
        self._cover_kind.visible = tool is Tool.COVER
        self._walker_kind.visible = tool is Tool.OBSTACLE

    def refresh(self) -> None:
        """Show the selected thing's properties as they are now."""
        held = self._studio.selection
        thing = self._studio.find(held) if held is not None else None
        fields = _fields(held, thing)
        shape = (held, tuple(field.name for field in fields))
        if self._folder is None or shape != self._shape:
            self._rebuild(held, thing, fields)
            self._shape = shape
            return
        for field in fields:
            value = shown_value(thing, field)
            show_value(self._widgets[field.name], value)

    def _rebuild(self, held: Selection | None, thing: Any, fields: tuple[Field, ...]) -> None:
        if self._folder is not None:
            self._folder.remove()
        self._held, self._widgets = held, {}
        if held is None:
            self._folder = self._gui.add_folder("Nothing selected")
            with self._folder:
                self._gui.add_markdown("Click a thing in the scene to see what it is.")
            return
        self._folder = self._gui.add_folder(_title(held, thing))
        with self._folder:
            for field in fields:
                widget = field.add(self._gui, shown_value(thing, field))
                self._widgets[field.name] = widget
                self._desk.on_value(widget, lambda value, field=field: self._enter(held, field, value))
            self._add_actions(held, thing)

    def _add_actions(self, held: Selection, thing: Any) -> None:
        actions: dict[str, Any] = {}
        if held.kind in (Kind.OBSERVER, Kind.OBSTACLE):
            actions["Add patrol points"] = lambda: self._desk.viewer.arm(Tool.PATROL)
            if thing.patrol is not None:
                actions["Clear patrol"] = lambda: tools.update(self._studio, held, {"patrol": None})
        if held.kind not in (Kind.START, Kind.GOAL):
            actions["Delete"] = lambda: self._studio.remove(held)
        for label, action in actions.items():
            self._desk.on_click(
                self._gui.add_button(label, color="red" if label == "Delete" else "gray"), action
            )

    def _enter(self, held: Selection, field: Field, value: Any) -> None:
        try:
            changes = field.changes(self._studio.find(held), value)
            tools.update(self._studio, held, changes, drag=self._entry(held, field))
        except Exception:
            self.refresh()
            raise

    def _entry(self, held: Selection, field: Field) -> str:
        """One undo entry for the keystrokes of a number, another for what is entered after a pause."""
        now = time.monotonic()
        if now - self._entered_at > PAUSE_S:
            self._entries += 1
        self._entered_at = now
        return f"{held.kind} {held.id} {field.name} {self._entries}"


def _fields(held: Selection | None, thing: Any) -> tuple[Field, ...]:
    if held is None:
        return ()
    patrolling = getattr(thing, "patrol", None) is not None
    return tuple(field for field in FIELDS[held.kind] if patrolling or not field.of_patrol)


def _title(held: Selection, thing: Any) -> str:
    match held.kind:
        case Kind.START | Kind.GOAL:
            return held.kind.value.capitalize()
        case Kind.COVER:
            return f"{CATALOGUE[thing.kind].class_name.capitalize()} {held.id}"
        case Kind.OBSTACLE:
            return f"{thing.kind.value.capitalize()} {held.id}"
    return f"Observer {held.id}"
