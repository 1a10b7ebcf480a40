"""From ray hits to pixels: surface class and colour under Lambert's law, in one pass over the image."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from scenes.rays import RayScene
from scenes.terrain import SURFACES, Surface

SUN = np.array([-0.4, -0.5, 0.77]) / np.linalg.norm([-0.4, -0.5, 0.77])
"""Unit vector toward the light, world frame."""

AMBIENT = 0.45
"""Share of the colour that a face turned away from the sun keeps."""

SKY_COLOUR = (176, 206, 235)
SURFACE_COLOURS = {
    Surface.GRASS: (112, 132, 84),
    Surface.TRAIL: (172, 152, 118),
    Surface.GRAVEL: (146, 141, 131),
    Surface.MUD: (104, 86, 66),
    Surface.SAND: (194, 176, 134),
    Surface.ROCK: (124, 120, 113),
    Surface.ASPHALT: (88, 89, 92),
    Surface.WATER: (74, 92, 92),
}
"""RGB, 0 to 255, of the ground in an image; a row of `_GROUND_COLOURS` each."""

_GROUND_COLOURS = np.array([SURFACE_COLOURS[surface] for surface in SURFACES], np.uint8)
_SKY = np.array(SKY_COLOUR, np.uint8)
_SUN = SUN.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Shading:
    """surface : (n,) int8 index into `scenes.terrain.SURFACES` where the ground was hit, else -1
    rgb : (n, 3) uint8"""

    surface: np.ndarray
    rgb: np.ndarray


def shade(rays: RayScene, hits, origin: np.ndarray, directions: np.ndarray) -> Shading:
    """Surface and colour of what rays from `origin` (3,) along `directions` (n, 3) float32 have hit.

    A face seen from behind is lit as the side that one sees; there are no cast shadows.
    """
    heightmap = rays.heightmap
    place = np.array([heightmap.x_min, heightmap.y_min, heightmap.resolution])
    starts, colours = rays.colours
    return Shading(
        *shade_kernel(
            hits.distance, hits.body, hits.triangle, hits.normal, origin.astype(np.float64), directions,
            place, heightmap.surface, starts, colours, _GROUND_COLOURS, _SKY, _SUN, np.float32(AMBIENT),
        )
    )  # fmt: skip


@numba.njit(cache=True)
def shade_kernel(
    distance, body, triangle, normal, origin, directions,
    place, surface_map, starts, colours, ground_colours, sky, sun, ambient,
):  # fmt: skip
    """`shade` on arrays: place (3,) x_min, y_min and resolution of the surface map (rows, cols); body b's
    face colours are colours[starts[b] + triangle]. Returns (n,) int8 and (n, 3) uint8."""
    count = len(distance)
    surface = np.full(count, -1, np.int8)
    rgb = np.empty((count, 3), np.uint8)
    rows, columns = surface_map.shape
    for i in range(count):
        hit = body[i]
        if hit < 0:
            rgb[i, 0], rgb[i, 1], rgb[i, 2] = sky[0], sky[1], sky[2]
            continue
        if hit == 0:
            x = origin[0] + distance[i] * directions[i, 0]
            y = origin[1] + distance[i] * directions[i, 1]
            column = min(max(int(np.rint((x - place[0]) / place[2])), 0), columns - 1)
            row = min(max(int(np.rint((y - place[1]) / place[2])), 0), rows - 1)
            kind = surface_map[row, column]
            surface[i] = kind
            red, green, blue = ground_colours[kind, 0], ground_colours[kind, 1], ground_colours[kind, 2]
        else:
            face = starts[hit] + triangle[i]
            red, green, blue = colours[face, 0], colours[face, 1], colours[face, 2]
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        light = np.float32(0.0)
        if length > 0.0:
            light = (nx * sun[0] + ny * sun[1] + nz * sun[2]) / length
            if nx * directions[i, 0] + ny * directions[i, 1] + nz * directions[i, 2] > 0.0:
                light = -light
        bright = ambient + (np.float32(1.0) - ambient) * max(light, np.float32(0.0))
        rgb[i, 0] = np.uint8(np.rint(red * bright))
        rgb[i, 1] = np.uint8(np.rint(green * bright))
        rgb[i, 2] = np.uint8(np.rint(blue * bright))
    return surface, rgb
