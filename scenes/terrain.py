"""The ground: a height grid with a surface class and a measurement quality for each cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
from numba import njit

from scenes.catalogue import TraversabilityGroup

MIN_CELLS, MAX_CELLS = 8, 1024
MAX_HEIGHT = 9000.0


class Surface(StrEnum):
    """What the ground is made of; the letter is its symbol in scenario files."""

    GRASS = "g"
    TRAIL = "t"
    GRAVEL = "v"
    MUD = "m"
    SAND = "s"
    ROCK = "r"
    ASPHALT = "a"
    WATER = "w"


class Quality(StrEnum):
    """How a height is known: measured (or made), interpolated over a gap, or missing."""

    MEASURED = "."
    INTERPOLATED = "i"
    MISSING = "x"


SURFACE_GROUP = {
    Surface.GRASS: TraversabilityGroup.ROUGH,
    Surface.TRAIL: TraversabilityGroup.SMOOTH,
    Surface.GRAVEL: TraversabilityGroup.ROUGH,
    Surface.MUD: TraversabilityGroup.ROUGH,
    Surface.SAND: TraversabilityGroup.ROUGH,
    Surface.ROCK: TraversabilityGroup.BUMPY,
    Surface.ASPHALT: TraversabilityGroup.SMOOTH,
    Surface.WATER: TraversabilityGroup.FORBIDDEN,
}

SURFACES = tuple(Surface)
QUALITIES = tuple(Quality)
SURFACE_CODE = {surface: code for code, surface in enumerate(SURFACES)}
QUALITY_CODE = {quality: code for code, quality in enumerate(QUALITIES)}


@dataclass(frozen=True, eq=False)
class Heightmap:
    """heights : (rows, cols) float64 metres, row along +y, column along +x, samples at cell centres,
    the world origin at the middle of the grid
    resolution : metres between samples
    surface : (rows, cols) uint8 index into SURFACES
    quality : (rows, cols) uint8 index into QUALITIES

    Between samples the ground is two flat triangles a cell square, split along the diagonal from
    (row, col + 1) to (row + 1, col), the same as in the physics and in the ray scene.
    """

    heights: np.ndarray
    resolution: float
    surface: np.ndarray
    quality: np.ndarray

    @classmethod
    def from_symbols(
        cls,
        heights: np.ndarray,
        resolution: float,
        surface: Sequence[str],
        quality: Sequence[str] | None = None,
    ) -> Heightmap:
        measured = np.zeros(heights.shape, np.uint8)
        return cls(
            heights,
            resolution,
            _decode(surface, SURFACES),
            measured if quality is None else _decode(quality, QUALITIES),
        )

    def surface_symbols(self) -> tuple[str, ...]:
        return _encode(self.surface, SURFACES)

    def quality_symbols(self) -> tuple[str, ...] | None:
        """One string a row, or None where every cell is measured."""
        return _encode(self.quality, QUALITIES) if self.quality.any() else None

    @property
    def shape(self) -> tuple[int, int]:
        return self.heights.shape

    @property
    def x_min(self) -> float:
        """World x of column 0's samples."""
        return -0.5 * (self.shape[1] - 1) * self.resolution

    @property
    def y_min(self) -> float:
        """World y of row 0's samples."""
        return -0.5 * (self.shape[0] - 1) * self.resolution

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, east, south, north: the outermost samples."""
        return self.x_min, -self.x_min, self.y_min, -self.y_min

    @property
    def relief(self) -> float:
        """Highest minus lowest ground, metres."""
        return float(np.ptp(self.heights))

    def contains(self, x: float, y: float) -> bool:
        west, east, south, north = self.bounds
        return west <= x <= east and south <= y <= north

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """(row, col) of the nearest sample, clipped to the map."""
        row, col = self.cells(x, y)
        return int(row), int(col)

    def cells(self, x, y) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the samples nearest to arrays of world points, clipped to the map."""
        row = np.rint((np.asarray(y, float) - self.y_min) / self.resolution).astype(int)
        col = np.rint((np.asarray(x, float) - self.x_min) / self.resolution).astype(int)
        return np.clip(row, 0, self.shape[0] - 1), np.clip(col, 0, self.shape[1] - 1)

    def surface_at(self, x: float, y: float) -> Surface:
        return SURFACES[self.surface[self.cell(x, y)]]

    def quality_at(self, x: float, y: float) -> Quality:
        return QUALITIES[self.quality[self.cell(x, y)]]

    def xy(self) -> tuple[np.ndarray, np.ndarray]:
        """World x and y of every sample, each (rows, cols)."""
        return np.meshgrid(
            self.x_min + self.resolution * np.arange(self.shape[1]),
            self.y_min + self.resolution * np.arange(self.shape[0]),
        )

    def height_at(self, x, y) -> np.ndarray:
        """Ground height at world points, arrays that broadcast or scalars; clipped to the map, NaN where a
        coordinate is."""
        x, y = np.asarray(x, float), np.asarray(y, float)
        if x.shape != y.shape:
            x, y = np.broadcast_arrays(x, y)
        heights = heights_between(self.heights, self.x_min, self.y_min, self.resolution, x.ravel(), y.ravel())
        return heights.reshape(x.shape)

    @cached_property
    def slope(self) -> np.ndarray:
        """(rows, cols) steepest inclination in radians, central differences."""
        dy, dx = np.gradient(self.heights, self.resolution)
        return np.arctan(np.hypot(dx, dy))

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """The ground as vertices (n, 3) and upward faces (m, 3), in the split that the docstring gives."""
        rows, cols = self.shape
        x, y = self.xy()
        vertices = np.column_stack([x.ravel(), y.ravel(), self.heights.ravel()])
        index = np.arange(rows * cols).reshape(rows, cols)
        near, east = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
        north, far = index[1:, :-1].ravel(), index[1:, 1:].ravel()
        faces = np.concatenate([np.column_stack([near, east, north]), np.column_stack([east, far, north])])
        return vertices, faces


@njit(cache=True)
def heights_between(samples, x_min, y_min, resolution, x, y):
    """(n,) heights of the ground at x, y (n,) between its samples (rows, cols), of which [0, 0] lies at
    (x_min, y_min); off the map that of its nearest edge."""
    rows, cols = samples.shape
    heights = np.empty(len(x))
    for i in range(len(x)):
        u, v = (x[i] - x_min) / resolution, (y[i] - y_min) / resolution
        if math.isnan(u) or math.isnan(v):
            heights[i] = math.nan
            continue
        u, v = min(max(u, 0.0), cols - 1.0), min(max(v, 0.0), rows - 1.0)
        col, row = min(int(u), cols - 2), min(int(v), rows - 2)
        u, v = u - col, v - row
        east, north = samples[row, col + 1], samples[row + 1, col]
        if u + v <= 1.0:
            near = samples[row, col]
            heights[i] = near + u * (east - near) + v * (north - near)
        else:
            far = samples[row + 1, col + 1]
            heights[i] = far + (1.0 - u) * (north - far) + (1.0 - v) * (east - far)
    return heights


def _decode(rows: Sequence[str], symbols: tuple[StrEnum, ...]) -> np.ndarray:
    lookup = np.zeros(256, np.uint8)
    for index, symbol in enumerate(symbols):
        lookup[ord(symbol.value)] = index
    codes = np.frombuffer("".join(rows).encode("ascii"), np.uint8).reshape(len(rows), -1)
    return lookup[codes]


def _encode(cells: np.ndarray, symbols: tuple[StrEnum, ...]) -> tuple[str, ...]:
    lookup = np.array([ord(symbol.value) for symbol in symbols], np.uint8)
    return tuple(row.tobytes().decode("ascii") for row in lookup[cells])
