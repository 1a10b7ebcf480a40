"""The ground as it is drawn: a relief with a painted texture, the map's cut edge, and sheets of water."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from PIL import Image, ImageFilter
from scipy import ndimage

from app.view import palette
from app.view.glb import Surface as Mesh
from app.view.glb import glb
from scenes.terrain import QUALITIES, SURFACES, Heightmap, Quality, Surface

MAX_DRAWN = 360
MAX_TEXTURE = 1200
RAGGED = 0.2
SKIRT = 1.2
CONTOURS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 25.0, 50.0)
SUN = np.array([-0.5, 0.6, 0.62]) / np.linalg.norm([-0.5, 0.6, 0.62])


def terrain_glb(heightmap: Heightmap, picture: np.ndarray) -> bytes:
    """The relief with its picture, as `painted`, and the earth that shows at the map's cut edge."""
    drawn = coarsened(heightmap)
    return glb(_relief(drawn, jpeg(picture)), _skirt(drawn))


def coarsened(heightmap: Heightmap) -> Heightmap:
    """The same ground with at most `MAX_DRAWN` samples a side, resampled over the same bounds."""
    rows, cols = heightmap.shape
    step = max(rows, cols) / MAX_DRAWN
    if step <= 1.0:
        return heightmap
    size = (round((rows - 1) / step) + 1, round((cols - 1) / step) + 1)
    resolution = heightmap.resolution * (cols - 1) / (size[1] - 1)
    v = np.linspace(0, rows - 1, size[0])
    u = np.linspace(0, cols - 1, size[1])
    grid = np.meshgrid(v, u, indexing="ij")
    near = np.ix_(np.rint(v).astype(int), np.rint(u).astype(int))
    heights = ndimage.map_coordinates(heightmap.heights, grid, order=1)
    return Heightmap(heights, resolution, heightmap.surface[near], heightmap.quality[near])


def _relief(ground: Heightmap, texture: bytes) -> Mesh:
    vertices, faces = ground.triangles()
    rows, cols = ground.shape
    dy, dx = np.gradient(ground.heights, ground.resolution)
    normals = np.dstack([-dx, -dy, np.ones_like(dx)]).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    v, u = np.mgrid[0:rows, 0:cols]
    uv = np.column_stack([(u.ravel() + 0.5) / cols, 1.0 - (v.ravel() + 0.5) / rows])
    return Mesh(vertices, faces, normals=normals, uv=uv, texture=texture, roughness=1.0)


def _skirt(ground: Heightmap) -> Mesh:
    """Vertical walls about the map, down to a level floor, so that it reads as a block of land."""
    floor = float(ground.heights.min()) - SKIRT
    vertices, _ = ground.triangles()
    rows, cols = ground.shape
    index = np.arange(rows * cols).reshape(rows, cols)
    loop = np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    top = vertices[loop]
    bottom = np.column_stack([top[:, :2], np.full(len(top), floor)])
    n = np.arange(len(loop))
    following = np.roll(n, -1)
    low, low_next = n + len(loop), following + len(loop)
    faces = np.concatenate([np.column_stack([n, low, low_next]), np.column_stack([n, low_next, following])])
    shade = np.concatenate([np.full(len(loop), 1.0), np.full(len(loop), 0.55)])
    colours = (np.array(palette.EARTH)[None] * shade[:, None]).astype(np.uint8)
    return Mesh(np.concatenate([top, bottom]), faces, colours, double_sided=True)


def jpeg(picture: np.ndarray) -> bytes:
    """A picture (height, width, 3) uint8 with south first, for a texture."""
    with io.BytesIO() as buffer:
        Image.fromarray(picture[::-1]).save(buffer, "JPEG", quality=84)
        return buffer.getvalue()


def painted(heightmap: Heightmap) -> np.ndarray:
    """The ground's picture (height, width, 3) uint8, south first: surface colours with soft ragged borders,
    a light hill shade, contour lines, and grey hatching where the survey interpolated or has nothing."""
    rows, cols = heightmap.shape
    scale = min(6.0, MAX_TEXTURE / max(rows, cols))
    size = (max(round(rows * scale), 2), max(round(cols * scale), 2))
    metre = size[1] / (cols * heightmap.resolution)
    rng = np.random.default_rng(7)
    row, col = _samples(heightmap, size, metre, rng)
    image = _surface_colours(heightmap.surface[row, col], metre)
    heights = _stretched(heightmap.heights, size)
    tufts = (
        0.5 * _noise(size, metre, 5.0, rng)
        + 0.3 * _noise(size, metre, 0.7, rng)
        + 0.25 * _noise(size, metre, 0.12, rng)
    )
    image *= (_hill_shade(heights, metre) * (1.0 + 0.1 * tufts))[..., None]
    image *= (1.0 - _contours(heights, heightmap.relief))[..., None]
    _hatch(image, heightmap.quality[row, col])
    return np.clip(image, 0, 255).astype(np.uint8)


def _samples(
    heightmap: Heightmap, size: tuple[int, int], metre: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The map's (row, col) for every pixel, strayed by a fraction of a metre so that borders look grown."""
    rows, cols = heightmap.shape
    stray = RAGGED / heightmap.resolution
    row = (np.arange(size[0], dtype=np.float32)[:, None] + 0.5) * (rows / size[0]) - 0.5
    col = (np.arange(size[1], dtype=np.float32)[None] + 0.5) * (cols / size[1]) - 0.5
    row = row + stray * _noise(size, metre, 0.6, rng)
    col = col + stray * _noise(size, metre, 0.6, rng)
    return (
        np.clip(np.rint(row), 0, rows - 1).astype(np.int32),
        np.clip(np.rint(col), 0, cols - 1).astype(np.int32),
    )


def _surface_colours(surface: np.ndarray, metre: float) -> np.ndarray:
    table = np.array([palette.GROUND[surface] for surface in SURFACES], np.uint8)
    blurred = Image.fromarray(table[surface]).filter(ImageFilter.GaussianBlur(0.1 * metre))
    return np.asarray(blurred, np.float32)


def _stretched(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Values (rows, cols) as a smooth float32 image of `size` (height, width)."""
    image = Image.fromarray(np.ascontiguousarray(values, np.float32))
    return np.asarray(image.resize((size[1], size[0]), Image.Resampling.BICUBIC))


def _noise(size: tuple[int, int], metre: float, wavelength: float, rng: np.random.Generator) -> np.ndarray:
    """Smooth noise of about unit spread whose features are `wavelength` metres apart."""
    step = max(wavelength * metre, 1.0)
    return _stretched(
        rng.standard_normal((math.ceil(size[0] / step) + 1, math.ceil(size[1] / step) + 1)), size
    )


def _hill_shade(heights: np.ndarray, metre: float) -> np.ndarray:
    dy, dx = np.gradient(heights, 1.0 / metre)
    facing = (SUN[2] - SUN[0] * dx - SUN[1] * dy) / np.sqrt(1.0 + dx**2 + dy**2)
    return np.clip(1.0 + 1.1 * (facing - SUN[2]), 0.5, 1.4)


def _contours(heights: np.ndarray, relief: float) -> np.ndarray:
    """Darkening in 0 to 1 along about a dozen contour lines of even width; every fifth is stronger."""
    if relief < CONTOURS[0]:
        return np.zeros_like(heights)
    interval = next((step for step in CONTOURS if relief / step <= 14), CONTOURS[-1])
    dy, dx = np.gradient(heights)
    steepness = np.maximum(np.hypot(dx, dy), 1e-6)

    def lines(step: float, width: float) -> np.ndarray:
        away = np.abs((heights / step + 0.5) % 1.0 - 0.5) * step / steepness
        return np.clip(width - away, 0.0, 1.0) * np.clip(steepness / (0.003 * step), 0.0, 1.0)

    return np.maximum(0.16 * lines(interval, 1.1), 0.26 * lines(5 * interval, 1.5))


def _hatch(image: np.ndarray, quality: np.ndarray) -> None:
    if not quality.any():
        return
    stripe = ((np.add.outer(np.arange(image.shape[0]), np.arange(image.shape[1])) // 5) % 3 == 0)[..., None]
    grey = np.array(palette.NO_DATA, np.float32)
    missing = (quality == QUALITIES.index(Quality.MISSING))[..., None]
    guessed = (quality == QUALITIES.index(Quality.INTERPOLATED))[..., None]
    image[:] = np.where(missing, grey * np.where(stripe, 0.82, 1.0), image)
    image[:] = np.where(guessed & stripe, 0.6 * image + 0.4 * grey, image)


def water_glb(heightmap: Heightmap) -> bytes | None:
    """A level, slightly clear sheet over each stretch of water, or None where the map has none."""
    wet = heightmap.surface == SURFACES.index(Surface.WATER)
    if not wet.any():
        return None
    labelled: Any = ndimage.label(wet, structure=np.ones((3, 3)))
    pools, count = labelled
    x, y = heightmap.xy()
    half = 0.5 * heightmap.resolution
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    vertices, faces = [], []
    for pool in range(1, count + 1):
        inside = pools == pool
        level = float(np.quantile(heightmap.heights[inside], 0.9)) + 0.03
        centres = np.column_stack([x[inside], y[inside]])
        quads = (centres[:, None] + corners).reshape(-1, 2)
        start = sum(len(v) for v in vertices)
        first = start + 4 * np.arange(len(centres))[:, None]
        vertices.append(np.column_stack([quads, np.full(len(quads), level)]))
        faces.append(np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])]))
    everything = np.concatenate(vertices)
    colours = np.tile(np.array([*palette.WATER, 190], np.uint8), (len(everything), 1))
    normals = np.tile((0.0, 0.0, 1.0), (len(everything), 1))
    return glb(Mesh(everything, np.concatenate(faces), colours, normals, blended=True, roughness=0.25))
