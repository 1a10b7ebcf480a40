"""Which properties of a thing a person can edit, with the widget for each. The scenario's own rules decide
what is allowed; bounds here only guide the hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import viser

from app.changes import Kind
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.scenario import ObstacleKind


@dataclass(frozen=True)
class Field:
    """One property: its name in the document, its label with the unit, and what kind of value it takes.

    choices : values with the words for them; step : of a number; of_patrol : a part of the walker's patrol
    """

    name: str
    label: str
    kind: type = float
    low: float | None = None
    high: float | None = None
    step: float = 0.1
    choices: dict[str, str] | None = None
    of_patrol: bool = False

    def add(self, gui: viser.GuiApi, value: Any) -> Any:
        """The widget, showing `value`."""
        if self.choices is not None:
            return gui.add_dropdown(self.label, tuple(self.choices), initial_value=value)
        if self.kind is bool:
            return gui.add_checkbox(self.label, value)
        if self.kind is str:
            return gui.add_text(self.label, value)
        return gui.add_number(self.label, value, min=self.low, max=self.high, step=self.step)

    def changes(self, thing: Any, value: Any) -> dict[str, Any]:
        """What to change in the document when a person enters `value`."""
        if self.choices is not None:
            value = self.choices.get(value, value)
        elif self.kind is str:
            value = value.strip() or None
        elif self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if self.of_patrol:
            return {"patrol": thing.patrol.model_dump() | {self.name: value}}
        return {self.name: value}


def shown_value(thing: Any, field: Field) -> Any:
    """The property as its widget shows it."""
    value = getattr(thing.patrol if field.of_patrol else thing, field.name)
    if field.choices is not None:
        return next(words for words, choice in field.choices.items() if choice == value)
    if field.kind is float:
        return round(float(value), 3)
    return "" if value is None else value


_PLACE = (Field("x", "x (m)"), Field("y", "y (m)"))
_YAW = Field("yaw", "Facing (°)", low=-360.0, high=360.0, step=1.0)
_NAME = Field("name", "Name", str)
_BEAT = (
    Field("speed", "Walks at (m/s)", low=0.05, high=20.0, of_patrol=True),
    Field("loop", "Beat is a loop", bool, of_patrol=True),
)

FIELDS: dict[Kind, tuple[Field, ...]] = {
    Kind.GOAL: _PLACE,
    Kind.START: (*_PLACE, _YAW),
    Kind.COVER: (
        _NAME,
        Field(
            "kind",
            "Class",
            choices={entry.class_name: CoverKind(kind).value for kind, entry in CATALOGUE.items()},
        ),
        *_PLACE,
        _YAW,
        Field("length", "Length (m)", low=0.05, high=60.0),
        Field("width", "Width (m)", low=0.05, high=60.0),
        Field("height", "Height (m)", low=0.05, high=60.0),
    ),
    Kind.OBSERVER: (
        _NAME,
        Field("known", "Known to the robot", bool),
        *_PLACE,
        _YAW,
        Field("eye_height", "Eye height (m)", low=0.0, high=100.0),
        Field("range", "Range (m)", low=0.0, high=5000.0, step=1.0),
        Field("fov_horizontal", "Field of view (°)", low=0.0, high=360.0, step=5.0),
        Field("fov_vertical", "Vertical field (°)", low=0.0, high=180.0, step=5.0),
        Field("detection_rate", "Notices at once (1/s)", low=0.0, high=1000.0),
        Field("detection_distance", "Notices within (m)", low=0.1, high=5000.0, step=1.0),
        *_BEAT,
    ),
    Kind.OBSTACLE: (
        _NAME,
        Field("kind", "Who", choices={kind.value: kind.value for kind in ObstacleKind}),
        *_PLACE,
        _YAW,
        *_BEAT,
    ),
}
