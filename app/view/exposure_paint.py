"""The exposure painted over the ground's own picture: seen orange, hidden blue-green, unknown hatching."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from PIL import Image
from scipy import ndimage

from app.view import palette
from app.view.glb import Reskinned, Surface
from app.view.ground import coarsened, jpeg
from app.view.tone import for_screen
from planner.exposure import SEEN, ExposureField
from scenes.terrain import Heightmap

MOST_PIXELS, ROUGH_PIXELS = 720, 320
PIXELS_A_CELL = 4
ROUGH_SAMPLES = 100  # a side of the mesh for pictures that hold for a moment only
LIFT = 0.02
OUTLINE = 0.5
"""How much of the picture's brightness is left along the edge between seen and hidden."""

LEVELS = 24
MOST_COUNTED = 5
SHADES = np.linspace(0.55, 1.3, 32, dtype=np.float32)
_PAD = 2


class Show(StrEnum):
    """What the overlay shows: exposure to anybody, how many see, the mean over the patrols' beats, or the
    chance that an observer not yet seen sees a place."""

    UNITED = "united"
    COUNT = "count"
    AVERAGED = "averaged"
    BELIEF = "belief"


@dataclass(frozen=True)
class Wish:
    """What people want to see; `observer` is the one whose view alone is shown, if any."""

    show: Show = Show.UNITED
    observer: int | None = None
    opacity: float = 0.6


@dataclass(frozen=True, eq=False)
class Paper:
    """The ground as it is drawn, to be painted on: made once a map, on any thread.

    picture : (height, width, 3) uint8, south first, in colours as they are to be sent
    shade : (height, width) index into SHADES, how light the ground is beside its surroundings
    mesh : the drawn ground, a little lifted
    rough : a smaller sheet of the same, for pictures that hold for a moment only
    """

    heightmap: Heightmap
    picture: np.ndarray
    shade: np.ndarray
    mesh: Reskinned
    rough: Paper | None = None

    @classmethod
    def of(cls, heightmap: Heightmap, picture: np.ndarray) -> Paper:
        """Of the ground's picture, as `app.view.ground.painted`."""
        rough = cls._sheet(heightmap, picture, Reskinned(_spread(heightmap)), ROUGH_PIXELS)
        mesh = Reskinned(_lifted(coarsened(heightmap)))
        return replace(cls._sheet(heightmap, picture, mesh, MOST_PIXELS), rough=rough)

    @classmethod
    def _sheet(cls, heightmap: Heightmap, picture: np.ndarray, mesh: Reskinned, most: int) -> Paper:
        rows, cols = heightmap.shape
        scale = min(PIXELS_A_CELL, most / max(rows, cols))
        size = max(round(cols * scale), 2), max(round(rows * scale), 2)
        ground = Image.fromarray(picture).resize(size, Image.Resampling.BOX)
        light = np.asarray(ground).astype(np.float32).mean(axis=2)
        blurred = Image.fromarray(light).reduce(max(size[0] // 45, 1))
        about = np.asarray(blurred.resize(size, Image.Resampling.BICUBIC))
        step = SHADES[1] - SHADES[0]
        shade = np.rint((light / np.maximum(about, 1.0) - SHADES[0]) / step).clip(0, len(SHADES) - 1)
        screen = for_screen(np.asarray(ground).reshape(-1, 3)).reshape(*shade.shape, 3)
        return cls(heightmap, screen, shade.astype(np.uint16), mesh)


def _lifted(ground: Heightmap) -> Surface:
    """The drawn ground's own triangles, so that the overlay never dips below them."""
    vertices, faces = ground.triangles()
    rows, cols = ground.shape
    v, u = np.mgrid[0:rows, 0:cols]
    uv = np.column_stack([(u.ravel() + 0.5) / cols, 1.0 - (v.ravel() + 0.5) / rows])
    return Surface(vertices + np.array([0.0, 0.0, LIFT]), faces, uv=uv, unlit=True)


def _spread(ground: Heightmap) -> Surface:
    """A sheet of few triangles spread over the ground's tops, light enough to be sent while things move."""
    vertices, _ = ground.triangles()
    rows, cols = ground.shape
    step = math.ceil(max(rows, cols) / ROUGH_SAMPLES)
    v, u = (np.unique(np.append(np.arange(0, count, step), count - 1)) for count in (rows, cols))
    index = np.arange(rows * cols).reshape(rows, cols)[np.ix_(v, u)]
    picked = vertices[index.ravel()]
    picked[:, 2] = ndimage.maximum_filter(ground.heights, step + 1)[np.ix_(v, u)].ravel() + LIFT
    grid_v, grid_u = np.meshgrid(v, u, indexing="ij")
    uv = np.column_stack([(grid_u.ravel() + 0.5) / cols, 1.0 - (grid_v.ravel() + 0.5) / rows])
    corner = np.arange(index.size).reshape(index.shape)
    near, east = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel()
    north, far = corner[1:, :-1].ravel(), corner[1:, 1:].ravel()
    faces = np.concatenate([np.column_stack([near, east, north]), np.column_stack([east, far, north])])
    return Surface(picked, faces, uv=uv, unlit=True)


def overlay_glb(field: ExposureField, wish: Wish, paper: Paper) -> bytes:
    """The ground with the exposure over it, as a mesh."""
    return paper.mesh.glb(jpeg(painted_exposure(field, wish, paper)))


def painted_exposure(field: ExposureField, wish: Wish, paper: Paper) -> np.ndarray:
    """(height, width, 3) uint8, south first, in colours as they are to be sent."""
    values, unknown = _values(field, wish), field.unknown
    counting = wish.show is Show.COUNT and wish.observer is None
    size = paper.picture.shape[:2]
    frame = _frame(field, paper.heightmap)
    if counting:
        levels = _stretched(np.minimum(values, MOST_COUNTED), size, frame, Image.Resampling.NEAREST)
        table, seen = palette.count_colours(MOST_COUNTED), levels >= 1
    else:
        share = _stretched(np.where(unknown, 0.0, values), size, frame, Image.Resampling.BILINEAR)
        if unknown.any():
            known = _stretched(~unknown, size, frame, Image.Resampling.BILINEAR)
            share = share / np.maximum(known, 1e-3)
        table, seen = palette.exposure_colours(np.linspace(0.0, 1.0, LEVELS)), share >= SEEN
        levels = np.rint(np.clip(share, 0.0, 1.0) * (LEVELS - 1))
    levels = levels.astype(np.uint8)
    if unknown.any():
        blank = _stretched(unknown, size, frame, Image.Resampling.NEAREST) > 0.5
        stripe = (np.add.outer(np.arange(size[0]), np.arange(size[1])) // 4) % 3 == 0
        levels[blank] = len(table) + stripe[blank]
        seen[blank] = False
        table = np.concatenate([table, [palette.UNKNOWN, palette.UNKNOWN_STRIPE]])
    picture = _mixed(levels, for_screen(table.astype(np.uint8)), wish.opacity, paper)
    if wish.show not in (Show.AVERAGED, Show.BELIEF) or wish.observer is not None:
        _outline(picture, seen, wish.opacity)
    return picture


def _values(field: ExposureField, wish: Wish) -> np.ndarray:
    """(rows, cols) of what is wished for; one who has gone sees nothing."""
    if wish.observer is not None:
        known = wish.observer in field.observer_ids
        return field.of(wish.observer) if known else np.zeros(field.unknown.shape, np.float32)
    if wish.show is Show.BELIEF:
        return field.united / likeliest(field)
    return field.count if wish.show is Show.COUNT else field.united


def likeliest(field: ExposureField) -> float:
    """The greatest exposure anywhere, for a scale that ends there; 1 where nothing is seen."""
    known = field.united[~field.unknown]
    return float(known.max(initial=0.0)) or 1.0


def _mixed(levels: np.ndarray, table: np.ndarray, opacity: float, paper: Paper) -> np.ndarray:
    """Colours of a table (n, 3) over the ground, in its light and shade."""
    shaded = np.minimum(table[:, None] * SHADES[:, None], 255.0)
    tints = (opacity * shaded).astype(np.uint8).reshape(-1, 3)
    grounds = ((1.0 - opacity) * np.arange(256)).astype(np.uint8)
    tint = np.take(tints, levels * np.uint16(len(SHADES)) + paper.shade, axis=0)
    return np.add(tint, np.take(grounds, paper.picture), out=tint)


def _outline(picture: np.ndarray, seen: np.ndarray, opacity: float) -> None:
    """Darken the edge between seen and hidden, so that it reads on dark and on light ground."""
    edge = np.zeros(seen.shape, bool)
    edge[1:] = seen[1:] != seen[:-1]
    edge[:, 1:] |= seen[:, 1:] != seen[:, :-1]
    picture[edge] = (1.0 - OUTLINE * min(1.0, 1.5 * opacity)) * picture[edge]


def _frame(field: ExposureField, heightmap: Heightmap) -> tuple[float, float, float, float]:
    """The map's west, south, east and north edges in the field's cells, counted from the padding's corner."""
    half = 0.5 * heightmap.resolution
    west, east, south, north = heightmap.bounds
    cell, corner = field.resolution, 0.5 + _PAD
    return (
        (west - half - field.x_min) / cell + corner,
        (south - half - field.y_min) / cell + corner,
        (east + half - field.x_min) / cell + corner,
        (north + half - field.y_min) / cell + corner,
    )


def _stretched(
    values: np.ndarray,
    size: tuple[int, int],
    frame: tuple[float, float, float, float],
    resampling: Image.Resampling,
) -> np.ndarray:
    """Values (rows, cols) as a float32 image of `size` (height, width) over the map."""
    padded = np.pad(values.astype(np.float32), _PAD, mode="edge")
    return np.array(Image.fromarray(padded).resize((size[1], size[0]), resampling, box=frame))
