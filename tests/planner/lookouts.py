"""Small scenes to look over."""

import numpy as np

from planner.line_of_sight import View, views_at
from scenes.rays import RayScene
from scenes.scenario import CoverObject, Observer
from scenes.terrain import QUALITIES, Heightmap, Quality


def ground(heights=None, cells: int = 41, resolution: float = 0.5, missing=None) -> Heightmap:
    """Grass, level and 20 m square by default; `heights` of (x, y), `missing` (rows, cols) bool."""
    grass, quality = np.zeros((2, cells, cells), np.uint8)
    flat = Heightmap(np.zeros((cells, cells)), resolution, grass, quality)
    if missing is not None:
        quality[missing] = QUALITIES.index(Quality.MISSING)
    relief = flat.heights if heights is None else heights(*flat.xy())
    return Heightmap(relief, resolution, flat.surface, quality)


def ridge(x, y):
    """A wall of earth along y at x = 0, 2 m high."""
    return 2.0 * np.exp(-(x**2))


def thing(kind: str, x: float, y: float, id: int = 1, **fields) -> CoverObject:
    return CoverObject.model_validate({"id": id, "kind": kind, "x": x, "y": y} | fields)


def observer(x: float, y: float, id: int = 1, **fields) -> Observer:
    """Sees all round for 100 m unless told."""
    usual = {"fov_horizontal": 360.0, "fov_vertical": 180.0, "range": 100.0}
    return Observer.model_validate(usual | {"id": id, "x": x, "y": y} | fields)


def view(heightmap: Heightmap, x: float, y: float, **fields) -> View:
    return views_at([observer(x, y, **fields)], heightmap, 0.0)[0]


def stage(heights=None, cover=(), **fields) -> tuple[Heightmap, RayScene]:
    heightmap = ground(heights, **fields)
    return heightmap, RayScene(heightmap, cover)
