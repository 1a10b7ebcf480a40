"""The ground as a document: a height grid with letters for surface and quality, and its source."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from scenes.document import Document, Name, between, several
from scenes.terrain import MAX_CELLS, MAX_HEIGHT, MIN_CELLS, Heightmap, Quality, Surface


class Family(StrEnum):
    """The paper's four terrains."""

    NORMAL = "normal"
    LOW = "low"
    LOW_HIGH = "low_high"
    FOREST = "forest"


class GeneratedSource(Document):
    """One of the paper's terrains, grown from a seed by `scenes.landscape` and perhaps edited since."""

    kind: Literal["generated"] = "generated"
    family: Family
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]


class SurveySource(Document):
    """Imported from measurements; (easting, northing, elevation) is where the scene's origin lies."""

    kind: Literal["survey"] = "survey"
    file: Name
    crs: Annotated[str, Field(max_length=4000)] | None = None
    easting: Annotated[float, between(-1e9, 1e9)] = 0.0
    northing: Annotated[float, between(-1e9, 1e9)] = 0.0
    elevation: Annotated[float, between(-12000.0, 9000.0)] = 0.0
    vertical_scale: Annotated[float, between(0.01, 100.0)] = 1.0


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
        raise ValueError(
            f"the map is {rows} × {columns} cells; each side must have {MIN_CELLS} to {MAX_CELLS}"
        )


HeightRows = Annotated[
    np.ndarray,
    PlainValidator(_check_heights),
    PlainSerializer(lambda heights: heights.tolist(), return_type=list),
    WithJsonSchema({"type": "array", "items": {"type": "array", "items": {"type": "number"}}}),
]
SymbolRows = Annotated[tuple[Annotated[str, Field(max_length=MAX_CELLS)], ...], several(MAX_CELLS)]


class Terrain(Document):
    """A height grid with a surface class and a measurement quality for every cell.

    heights : rows south to north, columns west to east, metres, samples at cell centres
    surface : one string a row, one letter a cell, see `scenes.terrain.Surface`
    quality : likewise, see `scenes.terrain.Quality`; left out where every cell was measured or made
    """

    resolution: Annotated[float, between(0.05, 10.0)]
    heights: HeightRows
    surface: SymbolRows
    quality: SymbolRows | None = None
    source: GeneratedSource | SurveySource = Field(discriminator="kind")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Terrain) and self._compared() == other._compared()

    def __hash__(self) -> int:
        return hash(self._compared())

    def _compared(self) -> tuple:
        heights = self.heights.shape, self.heights.tobytes()
        return self.resolution, self.surface, self.quality, self.source, heights

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
                    raise ValueError(
                        f"{field} row {index} has {len(row)} letters, not {self.heights.shape[1]}"
                    )
                if not set(row) <= symbols:
                    raise ValueError(
                        f"{field} row {index} may use only the letters {''.join(sorted(symbols))}"
                    )
        return self

    def heightmap(self) -> Heightmap:
        return Heightmap.from_symbols(self.heights, self.resolution, self.surface, self.quality)
