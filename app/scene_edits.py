"""What becomes of a scenario's fields by an edit. Nothing is changed here: the caller adopts what it gets."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import ValidationError

from app.changes import COLLECTIONS, Kind, Selection, StudioError
from scenes.document import MAX_ID
from scenes.robot import HUSKY
from scenes.scenario import Document, Scenario, first_message

Fields = dict[str, Any]


def validated(model: type[Document], fields: Fields) -> Any:
    """A document of `model`. Raises StudioError with its first complaint."""
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        raise StudioError(first_message(error)) from None


def find(scenario: Scenario, selection: Selection) -> Any:
    """The selected part of the scenario. Raises StudioError (404)."""
    if selection.kind in (Kind.START, Kind.GOAL):
        return getattr(scenario, selection.kind)
    collection = COLLECTIONS[selection.kind]
    for thing in getattr(scenario, collection.field):
        if thing.id == selection.id:
            return thing
    raise StudioError(f"there is no {collection.noun} {selection.id}", 404)


def exists(scenario: Scenario, selection: Selection) -> bool:
    try:
        return find(scenario, selection) is not None
    except StudioError:
        return False


def added(scenario: Scenario, kind: Kind, spec: Document) -> tuple[Fields, Any]:
    """The fields with one thing more, and the thing under its new id. Raises StudioError."""
    collection = COLLECTIONS[kind]
    things = getattr(scenario, collection.field)
    number = max((thing.id for thing in things), default=0) + 1
    if number > MAX_ID:
        number = min(set(range(1, len(things) + 2)) - {thing.id for thing in things})
    thing = validated(collection.model, spec.model_dump() | {"id": number})
    return {collection.field: (*things, thing)}, thing


def updated(scenario: Scenario, selection: Selection, changes: Fields) -> tuple[Fields, Any]:
    """The fields with one thing changed, and the thing as it is then. Raises StudioError."""
    old = find(scenario, selection)
    if "id" in changes and changes["id"] != selection.id:
        raise StudioError("id: cannot be changed")
    collection = COLLECTIONS[selection.kind]
    new = validated(collection.model, old.model_dump() | changes)
    things = getattr(scenario, collection.field)
    return {collection.field: tuple(new if thing is old else thing for thing in things)}, new


def removed(scenario: Scenario, selection: Selection) -> Fields:
    """The fields without one thing. Raises StudioError, also for start and goal."""
    collection = COLLECTIONS.get(selection.kind)
    if collection is None:
        raise StudioError(f"the {selection.kind} cannot be deleted; move it instead", 409)
    gone = find(scenario, selection)
    things = getattr(scenario, collection.field)
    return {collection.field: tuple(thing for thing in things if thing is not gone)}


def keep_off_the_robot(before: Scenario, after: Scenario, x: float, y: float, time_s: float) -> None:
    """Raises StudioError (409) where something new stands at `time_s` where the robot does, at (x, y)."""
    here, room = np.array([[x, y]]), HUSKY.circumscribed_radius
    new = [thing.footprint for thing in _new(before.cover, after.cover)]
    new += [thing.footprint_at(time_s) for thing in _new(before.obstacles, after.obstacles)]
    if any(outline.distance(here)[0] < room for outline in new):
        raise StudioError(f"the robot stands there: keep {room:.1f} m away from it", 409)


def _new(before: tuple[Any, ...], after: tuple[Any, ...]) -> set[Any]:
    return set() if before == after else set(after) - set(before)
