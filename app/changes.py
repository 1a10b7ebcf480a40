"""What may be refused, what may change, and how parts of a scenario are named."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from app.store import StoreError, UnknownEntry
from scenes.scenario import CoverObject, Document, MovingObstacle, Observer, ScenarioError


class StudioError(ValueError):
    """A command that is refused, in one sentence for the person; `status` is its HTTP status."""

    def __init__(self, message: str, status: int = 422) -> None:
        super().__init__(message)
        self.status = status


REFUSALS = (StudioError, ScenarioError, StoreError, UnknownEntry)


class Change(StrEnum):
    """What a listener is told of: another scenario, an edit, the selection, a frame, the mission's status,
    the settings, the list of saved scenarios, who sees what, the view's picture of that, the routes
    that are compared, and the trainings."""

    OPENED = "opened"
    EDITED = "edited"
    SELECTED = "selected"
    FRAME = "frame"
    STATUS = "status"
    SETTINGS = "settings"
    LIBRARY = "library"
    EXPOSURE = "exposure"
    OVERLAY = "overlay"
    ROUTES = "routes"
    TRAINING = "training"


class Kind(StrEnum):
    START = "start"
    GOAL = "goal"
    OBSERVER = "observer"
    COVER = "cover"
    OBSTACLE = "obstacle"


@dataclass(frozen=True)
class Selection:
    kind: Kind
    id: int = 0


@dataclass(frozen=True)
class Overlay:
    """A picture of the exposure that has been sent to the browsers.

    edits : how many edits of the studio it heeds; sharp : whether every cell was looked at
    """

    edits: int
    sharp: bool


@dataclass(frozen=True)
class Collection:
    """Where things of a kind stand in the scenario."""

    field: str
    model: type[Document]
    noun: str


COLLECTIONS = {
    Kind.OBSERVER: Collection("observers", Observer, "observer"),
    Kind.COVER: Collection("cover", CoverObject, "cover object"),
    Kind.OBSTACLE: Collection("obstacles", MovingObstacle, "moving obstacle"),
}
