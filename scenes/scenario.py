"""The scenario document: all that a mission starts from, as versioned JSON that people can read and diff.

Positions are metres in the scene frame (x east, y north, origin at the middle of the map), angles are
degrees, counter-clockwise from east. Heights are metres above the map's own zero.
"""

from __future__ import annotations

import json
import math
import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from scenes.catalogue import CATALOGUE, CoverKind, Footprint, footprint
from scenes.document import (
    Coordinate,
    Degrees,
    Document,
    Identifier,
    Name,
    ScenarioError,
    between,
    first_message,
    several,
    write_atomically,
)
from scenes.patrol import patrol_pose
from scenes.robot import HUSKY
from scenes.terrain import Heightmap, Quality, Surface
from scenes.terrain_document import Family, GeneratedSource, SurveySource, Terrain

__all__ = [
    "CoverObject",
    "CoverSpec",
    "Document",
    "Family",
    "GeneratedSource",
    "MovingObstacle",
    "Name",
    "Observer",
    "ObserverSpec",
    "ObstacleKind",
    "ObstacleSpec",
    "Patrol",
    "Point",
    "Scenario",
    "ScenarioError",
    "Start",
    "SurveySource",
    "Terrain",
    "Walker",
    "between",
    "first_message",
    "husky_footprint",
    "off_the_map",
    "why_not_standing",
    "write_atomically",
]

MAX_COVER = 2000
STANDING_ROOM = 0.02
"""Metres between a Husky and what stands beside it, for Bullet takes nearer things for touching."""
MAX_OBSERVERS = 200
MAX_OBSTACLES = 100
MAX_WAYPOINTS = 100
MAX_FILE_BYTES = 16 * 2**20


class Point(Document):
    x: Coordinate
    y: Coordinate


class Start(Point):
    yaw: Degrees = 0.0


class Patrol(Document):
    """A beat from the walker's own position over the waypoints, back to the start or turning at the end."""

    waypoints: Annotated[tuple[Point, ...], several(MAX_WAYPOINTS, least=1)]
    speed: Annotated[float, between(0.05, 20.0)] = 1.2
    loop: bool = True


class Walker(Point):
    """Something that stands or walks a beat."""

    yaw: Degrees = 0.0
    patrol: Patrol | None = None

    def pose_at(self, time_s: float) -> tuple[float, float, float]:
        """(x, y, yaw in radians) at `time_s`."""
        yaw = math.radians(self.yaw)
        if self.patrol is None:
            return self.x, self.y, yaw
        points = [(self.x, self.y), *((p.x, p.y) for p in self.patrol.waypoints)]
        return patrol_pose(points, self.patrol.speed, self.patrol.loop, yaw, time_s)


class ObserverSpec(Walker):
    """One who watches: eye height over the ground, facing `yaw`, field of view and range.

    detection_rate, detection_distance : how soon it notices what it sees, a second at point-blank range in
        plain view, and the metres at which that has fallen to 1/e (`planner.detection_model`)
    """

    name: Name | None = None
    eye_height: Annotated[float, between(0.0, 100.0)] = 1.7
    fov_horizontal: Annotated[float, between(0.0, 360.0)] = 120.0
    fov_vertical: Annotated[float, between(0.0, 180.0)] = 90.0
    range: Annotated[float, between(0.0, 5000.0)] = 40.0
    detection_rate: Annotated[float, between(0.0, 1000.0)] = 1.0
    detection_distance: Annotated[float, between(0.1, 5000.0)] = 20.0
    known: bool = True


class Observer(ObserverSpec):
    id: Identifier


def _usual(side: str) -> Any:
    """Default of one side: the class's usual size."""
    return lambda data: getattr(CATALOGUE[data["kind"]], side).usual if "kind" in data else None


class CoverSpec(Point):
    """A cover object; a side that is left out, or null, takes the class's usual size."""

    kind: CoverKind
    name: Name | None = None
    yaw: Degrees = 0.0
    length: Annotated[float, between(0.05, 60.0)] = Field(default_factory=_usual("length"))
    width: Annotated[float, between(0.05, 60.0)] = Field(default_factory=_usual("width"))
    height: Annotated[float, between(0.05, 60.0)] = Field(default_factory=_usual("height"))

    @field_validator("length", "width", "height", mode="before")
    @classmethod
    def _null_is_usual(cls, value: Any, info: ValidationInfo) -> Any:
        return _usual(str(info.field_name))(info.data) if value is None else value

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width, height in metres."""
        return self.length, self.width, self.height

    @property
    def footprint(self) -> Footprint:
        return footprint(self.kind, self.x, self.y, math.radians(self.yaw), self.length, self.width)


class CoverObject(CoverSpec):
    id: Identifier


class ObstacleKind(StrEnum):
    PERSON = "person"
    VEHICLE = "vehicle"


OBSTACLE_SIZES = {ObstacleKind.PERSON: (0.5, 0.5, 1.75), ObstacleKind.VEHICLE: (4.4, 1.9, 1.7)}


class ObstacleSpec(Walker):
    """A person or vehicle that moves on its beat; it does not look for the robot."""

    kind: ObstacleKind
    name: Name | None = None

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width, height in metres."""
        return OBSTACLE_SIZES[self.kind]

    def footprint_at(self, time_s: float) -> Footprint:
        x, y, yaw = self.pose_at(time_s)
        length, width, _ = self.size
        return Footprint(x, y, yaw, length, width, round=self.kind is ObstacleKind.PERSON)


class MovingObstacle(ObstacleSpec):
    id: Identifier


class Scenario(Document):
    """The whole document; see the module's docstring for its conventions."""

    version: Literal[1]
    name: Name
    description: Annotated[str, Field(max_length=2000)] = ""
    terrain: Terrain
    start: Start
    goal: Point
    cover: Annotated[tuple[CoverObject, ...], several(MAX_COVER)] = ()
    observers: Annotated[tuple[Observer, ...], several(MAX_OBSERVERS)] = ()
    obstacles: Annotated[tuple[MovingObstacle, ...], several(MAX_OBSTACLES)] = ()

    @model_validator(mode="after")
    def _places_make_sense(self) -> Scenario:
        heightmap = self.terrain.heightmap()
        for field, things in (
            ("cover", self.cover),
            ("observers", self.observers),
            ("obstacles", self.obstacles),
        ):
            seen: set[int] = set()
            for index, thing in enumerate(things):
                if thing.id in seen:
                    raise ValueError(f"{field}[{index}].id {thing.id} is used twice")
                seen.add(thing.id)
                beat = thing.patrol.waypoints if isinstance(thing, Walker) and thing.patrol else ()
                for point in (thing, *beat):
                    if not heightmap.contains(point.x, point.y):
                        raise ValueError(f"{field}[{index}] " + off_the_map(heightmap, point.x, point.y))
        yaw = math.radians(self.start.yaw)
        for field, point, heading in (("start", self.start, yaw), ("goal", self.goal, None)):
            reason = why_not_standing(heightmap, self.cover, point.x, point.y, heading)
            if reason:
                raise ValueError(f"{field} {reason}")
        body = husky_footprint(self.start.x, self.start.y, yaw)
        for index, obstacle in enumerate(self.obstacles):
            if obstacle.footprint_at(0.0).gap(body) < STANDING_ROOM:
                raise ValueError(f"obstacles[{index}] begins where the robot starts; move one of them")
        return self

    def revised(self, **changes: Any) -> Scenario:
        """A copy with some fields replaced, validated again.

        Raises ScenarioError with one message where the result would not be a scenario."""
        fields = {name: getattr(self, name) for name in type(self).model_fields} | changes
        try:
            return Scenario(**fields)
        except ValidationError as error:
            raise ScenarioError(first_message(error)) from None

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scenario:
        """Read and check a file. Raises ScenarioError with one message that names file and place."""
        path = Path(path)
        try:
            if path.stat().st_size > MAX_FILE_BYTES:
                raise ScenarioError(
                    f"{path}: larger than {MAX_FILE_BYTES >> 20} MiB, which no scenario needs"
                )
            text = path.read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(
                f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"
            ) from None
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise ScenarioError(f"{path}: {first_message(error)}") from None

    def to_json(self) -> str:
        """The document as text, one map row a line, so that a diff shows what changed."""
        document = self.model_dump(mode="json", exclude_none=True)
        rows = document["terrain"].pop("heights")
        text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
        lines = ",\n".join("   " + json.dumps(row, separators=(",", ":")) for row in rows)
        head = '\n "terrain": {'
        return text.replace(head, f'{head}\n  "heights": [\n{lines}\n  ],', 1) + "\n"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write atomically: the file holds either the old document or the new one, whatever happens."""
        write_atomically(Path(path), self.to_json())


def off_the_map(heightmap: Heightmap, x: float, y: float) -> str:
    west, east, south, north = heightmap.bounds
    return (
        f"is off the map at ({x:g}, {y:g}): x must lie within {west:g} to {east:g}"
        f" and y within {south:g} to {north:g}"
    )


def why_not_standing(
    heightmap: Heightmap, cover: tuple[CoverObject, ...], x: float, y: float, yaw: float | None = None
) -> str | None:
    """Why a Husky cannot stand at (x, y), in words that follow 'the goal'; None where it can.

    yaw : radians, the heading that it has there; without one, only what hinders it in any is told"""
    if not heightmap.contains(x, y):
        return off_the_map(heightmap, x, y)
    if heightmap.surface_at(x, y) is Surface.WATER:
        return f"is in water at ({x:g}, {y:g})"
    if heightmap.quality_at(x, y) is Quality.MISSING:
        return f"is where the survey has no data at ({x:g}, {y:g})"
    body = None if yaw is None else husky_footprint(x, y, yaw)
    needed = HUSKY.inscribed_radius if body is None else HUSKY.circumscribed_radius
    west, east, south, north = heightmap.bounds
    edge = min(x - west, east - x, y - south, north - y)
    if edge < needed and (body is None or not all(heightmap.contains(*corner) for corner in body.corners)):
        return f"is {edge:.2f} m from the map's edge at ({x:g}, {y:g}); the Husky needs {needed:.2f} m"
    for thing in cover:
        if math.dist((thing.x, thing.y), (x, y)) > 0.5 * math.hypot(thing.length, thing.width) + 1.0:
            continue
        gap = float(thing.footprint.distance(np.array([[x, y]]))[0])
        label = f"{CATALOGUE[thing.kind].class_name} {thing.id}"
        if gap < 0.0:
            return f"is inside a {label} at ({x:g}, {y:g})"
        if gap < HUSKY.inscribed_radius or (body is not None and thing.footprint.gap(body) < STANDING_ROOM):
            return f"is {gap:.2f} m from {label}; the Husky needs {needed:.2f} m"
    return None


def husky_footprint(x: float, y: float, yaw: float) -> Footprint:
    """What a Husky with its middle at (x, y) and that heading in radians covers."""
    return Footprint(x, y, yaw, HUSKY.length, HUSKY.width, round=False)
