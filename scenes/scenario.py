"""The scenario document: all that a mission starts from, as versioned JSON that people can read and diff.

Positions are metres in the scene frame (x east, y north, origin at the middle of the map), angles are
degrees, counter-clockwise from east. Heights are metres above the map's own zero.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from scenes.catalogue import CATALOGUE, CoverKind, Footprint, footprint
from scenes.patrol import patrol_pose
from scenes.robot import HUSKY
from scenes.terrain import MAX_CELLS, MAX_HEIGHT, MIN_CELLS, Heightmap, Quality, Surface

MAX_COVER = 2000
MAX_OBSERVERS = 200
MAX_OBSTACLES = 100
MAX_WAYPOINTS = 100
MAX_FILE_BYTES = 32 * 2**20

Coordinate = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-5000.0, le=5000.0)]
Degrees = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-360.0, le=360.0)]
Identifier = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f<>]+$")]


def Metres(low: float, high: float) -> Any:  # noqa: N802 - reads as a type
    return Annotated[float, Field(strict=True, allow_inf_nan=False, ge=low, le=high)]


class ScenarioError(ValueError):
    """A scenario that cannot be used; the message names the place and what would be right."""


class Document(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class Family(StrEnum):
    """The paper's four terrains."""

    NORMAL = "normal"
    LOW = "low"
    LOW_HIGH = "low_high"
    FOREST = "forest"


class GeneratedSource(Document):
    """Made by `scenes.families` from a seed."""

    kind: Literal["generated"] = "generated"
    family: Family
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]


class SurveySource(Document):
    """Imported from measurements; (easting, northing, elevation) is where the scene's origin lies."""

    kind: Literal["survey"] = "survey"
    file: Name
    crs: Annotated[str, Field(max_length=4000)] | None = None
    easting: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e9, le=1e9)] = 0.0
    northing: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e9, le=1e9)] = 0.0
    elevation: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-12000.0, le=9000.0)] = 0.0
    vertical_scale: Metres(0.01, 100.0) = 1.0


def _check_heights(value: Any) -> np.ndarray:
    if isinstance(value, list):
        rows, columns = len(value), len(value[0]) if value and isinstance(value[0], list) else 0
        _check_size(rows, columns)
        for index, row in enumerate(value):
            if not isinstance(row, list) or len(row) != columns:
                raise ValueError(f"row {index} must be a list of {columns} numbers like row 0")
            for column, height in enumerate(row):
                if type(height) not in (int, float):
                    raise ValueError(f"row {index}, column {column} must be a number, got {height!r:.40}")
        try:
            value = np.array(value, dtype=np.float64)
        except OverflowError:
            raise ValueError("a height is too large to be a number of metres") from None
    if not isinstance(value, np.ndarray) or value.ndim != 2:
        raise ValueError("must be rows of numbers, south to north")
    _check_size(*value.shape)
    bad = np.argwhere(~(np.abs(value) <= MAX_HEIGHT))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise ValueError(
            f"row {row}, column {column} is {value[row, column]}: "
            f"every height must be finite and within ±{MAX_HEIGHT:g} m"
        )
    value = np.round(value, 3)
    value.setflags(write=False)
    return value


def _check_size(rows: int, columns: int) -> None:
    if not (MIN_CELLS <= rows <= MAX_CELLS and MIN_CELLS <= columns <= MAX_CELLS):
        raise ValueError(f"the map is {rows} × {columns} cells; each side must have {MIN_CELLS} to {MAX_CELLS}")


HeightRows = Annotated[
    np.ndarray,
    PlainValidator(_check_heights),
    PlainSerializer(lambda heights: heights.tolist(), return_type=list),
    WithJsonSchema({"type": "array", "items": {"type": "array", "items": {"type": "number"}}}),
]
SymbolRows = Annotated[tuple[Annotated[str, Field(max_length=MAX_CELLS)], ...], Field(max_length=MAX_CELLS)]


class Terrain(Document):
    """A height grid with a surface class and a measurement quality for every cell.

    heights : rows south to north, columns west to east, metres, samples at cell centres
    surface : one string a row, one letter a cell, see `scenes.terrain.Surface`
    quality : likewise, see `scenes.terrain.Quality`; left out where every cell was measured or made
    """

    resolution: Metres(0.05, 10.0)
    heights: HeightRows
    surface: SymbolRows
    quality: SymbolRows | None = None
    source: GeneratedSource | SurveySource = Field(discriminator="kind")

    @model_validator(mode="after")
    def _symbols_fit(self) -> Terrain:
        for field, rows, symbols in (
            ("surface", self.surface, {s.value for s in Surface}),
            ("quality", self.quality, {q.value for q in Quality}),
        ):
            if rows is None:
                continue
            if len(rows) != self.heights.shape[0]:
                raise ValueError(f"{field} has {len(rows)} rows, heights has {self.heights.shape[0]}")
            for index, row in enumerate(rows):
                if len(row) != self.heights.shape[1]:
                    raise ValueError(f"{field} row {index} has {len(row)} letters, not {self.heights.shape[1]}")
                if not set(row) <= symbols:
                    raise ValueError(f"{field} row {index} may use only the letters {''.join(sorted(symbols))}")
        return self

    def heightmap(self) -> Heightmap:
        return Heightmap.from_symbols(self.heights, self.resolution, self.surface, self.quality)


class Point(Document):
    x: Coordinate
    y: Coordinate


class Start(Point):
    yaw: Degrees = 0.0


class Patrol(Document):
    """A beat from the walker's own position over the waypoints, back to the start or turning at the end."""

    waypoints: Annotated[tuple[Point, ...], Field(min_length=1, max_length=MAX_WAYPOINTS)]
    speed: Metres(0.05, 20.0) = 1.2
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
    """One who watches: eye height over the ground, facing `yaw`, field of view and range."""

    name: Name | None = None
    eye_height: Metres(0.0, 100.0) = 1.7
    fov_horizontal: Metres(0.0, 360.0) = 120.0
    fov_vertical: Metres(0.0, 180.0) = 90.0
    range: Metres(0.0, 5000.0) = 40.0
    known: bool = True


class Observer(ObserverSpec):
    id: Identifier


class CoverSpec(Point):
    """A cover object; a size that is left out takes the class's usual one."""

    kind: CoverKind
    name: Name | None = None
    yaw: Degrees = 0.0
    length: Metres(0.05, 60.0) | None = None
    width: Metres(0.05, 60.0) | None = None
    height: Metres(0.05, 60.0) | None = None

    @model_validator(mode="before")
    @classmethod
    def _usual_size(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("kind"), str) and data["kind"] in set(CoverKind):
            entry = CATALOGUE[CoverKind(data["kind"])]
            data = dict(data)
            for side in ("length", "width", "height"):
                if data.get(side) is None:
                    data[side] = getattr(entry, side).usual
        return data

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

    version: Literal[1] = 1
    name: Name
    description: Annotated[str, Field(max_length=2000)] = ""
    terrain: Terrain
    start: Start
    goal: Point
    cover: Annotated[tuple[CoverObject, ...], Field(max_length=MAX_COVER)] = ()
    observers: Annotated[tuple[Observer, ...], Field(max_length=MAX_OBSERVERS)] = ()
    obstacles: Annotated[tuple[MovingObstacle, ...], Field(max_length=MAX_OBSTACLES)] = ()

    @model_validator(mode="after")
    def _places_make_sense(self) -> Scenario:
        heightmap = self.terrain.heightmap()
        for field, things in (("cover", self.cover), ("observers", self.observers), ("obstacles", self.obstacles)):
            seen: set[int] = set()
            for index, thing in enumerate(things):
                if thing.id in seen:
                    raise ValueError(f"{field}[{index}].id {thing.id} is used twice")
                seen.add(thing.id)
                points = [thing]
                if isinstance(thing, Walker) and thing.patrol is not None:
                    points += thing.patrol.waypoints
                for point in points:
                    if not heightmap.contains(point.x, point.y):
                        raise ValueError(f"{field}[{index}] " + off_the_map(heightmap, point.x, point.y))
        for field, point in (("start", self.start), ("goal", self.goal)):
            reason = why_not_standing(heightmap, self.cover, point.x, point.y)
            if reason:
                raise ValueError(f"{field} {reason}")
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
                raise ScenarioError(f"{path}: larger than {MAX_FILE_BYTES >> 20} MiB, which no scenario needs")
            text = path.read_text("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
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


def write_atomically(path: Path, text: str) -> None:
    """Replace `path` by `text` in one step that survives a crash. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def off_the_map(heightmap: Heightmap, x: float, y: float) -> str:
    west, east, south, north = heightmap.bounds
    return (
        f"is off the map at ({x:g}, {y:g}): x must lie within {west:g} to {east:g}"
        f" and y within {south:g} to {north:g}"
    )


def why_not_standing(
    heightmap: Heightmap, cover: tuple[CoverObject, ...], x: float, y: float
) -> str | None:
    """Why a Husky cannot stand at (x, y), in words that follow 'the goal'; None where it can."""
    if not heightmap.contains(x, y):
        return off_the_map(heightmap, x, y)
    if heightmap.surface_at(x, y) is Surface.WATER:
        return f"is in water at ({x:g}, {y:g})"
    if heightmap.quality_at(x, y) is Quality.MISSING:
        return f"is where the survey has no data at ({x:g}, {y:g})"
    for thing in cover:
        gap = float(thing.footprint.distance(np.array([[x, y]]))[0])
        if gap < HUSKY.inscribed_radius:
            label = f"{CATALOGUE[thing.kind].class_name} {thing.id}"
            if gap < 0.0:
                return f"is inside a {label} at ({x:g}, {y:g})"
            return f"is {gap:.2f} m from {label}; the Husky needs {HUSKY.inscribed_radius:.2f} m"
    return None


def first_message(error: ValidationError) -> str:
    """One line for the first problem of a pydantic error: the field's path and what is wrong there."""
    problem = error.errors(include_url=False, include_context=False, include_input=False)[0]
    path = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    return f"{path}: {message}" if path else message
