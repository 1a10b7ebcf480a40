"""Coloured low-poly solids that the meshes of cover and figures are put together from.

Every face has its own vertices, so that colours end at edges and faces look flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh

Colour = tuple[int, int, int]

_BOX_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_BOX_FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
     (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Solid:
    """triangles : (n, 3, 3) metres; colours : (n, 3) RGB from 0 to 255, one a triangle."""

    triangles: np.ndarray
    colours: np.ndarray

    def __add__(self, other: Solid) -> Solid:
        return join(self, other)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        return Solid(self.triangles + np.array([x, y, z]), self.colours)

    def turned(self, rotation: np.ndarray) -> Solid:
        """Rotated about the origin by a (3, 3) matrix."""
        return Solid(self.triangles @ np.asarray(rotation).T, self.colours)

    def mottled(self, rng: np.random.Generator, amount: float) -> Solid:
        """Each face a little lighter or darker, by up to `amount` of its colour."""
        shade = 1.0 + rng.uniform(-amount, amount, (len(self.colours), 1))
        return Solid(self.triangles, np.clip(self.colours * shade, 0.0, 255.0))

    def shaded(self, low: float, high: float) -> Solid:
        """Brightness from `low` at the bottom to `high` at the top, as leaves shade each other."""
        z = self.triangles[:, :, 2].mean(axis=1)
        shade = low + (high - low) * (z - z.min()) / max(float(np.ptp(z)), 1e-9)
        return Solid(self.triangles, np.clip(self.colours * shade[:, None], 0.0, 255.0))

    def fitted(self, length: float, width: float, height: float) -> Solid:
        """Stretched so that it spans ±length/2, ±width/2 and reaches up to `height`; what lies below
        the ground keeps its depth."""
        points = self.triangles.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        middle, extent = 0.5 * (low + high)[:2], (high - low)[:2]
        scaled = np.empty_like(points)
        scaled[:, :2] = (points[:, :2] - middle) * ((length, width) / extent)
        scaled[:, 2] = points[:, 2] * np.where(points[:, 2] > 0.0, height / high[2], 1.0)
        return Solid(scaled.reshape(-1, 3, 3), self.colours)

    def mesh(self) -> trimesh.Trimesh:
        """As a mesh with vertex colours, three vertices a face."""
        vertices = self.triangles.reshape(-1, 3)
        colours = np.full((len(vertices), 4), 255, np.uint8)
        colours[:, :3] = np.repeat(np.rint(self.colours), 3, axis=0)
        return trimesh.Trimesh(
            vertices, np.arange(len(vertices)).reshape(-1, 3), vertex_colors=colours, process=False
        )


def join(*solids: Solid) -> Solid:
    return Solid(
        np.concatenate([solid.triangles for solid in solids]),
        np.concatenate([solid.colours for solid in solids]),
    )


def convex(points: np.ndarray, faces: np.ndarray, colour: Colour) -> Solid:
    """A convex body of points (n, 3) and faces (m, 3) in any winding; its faces are turned outward."""
    triangles = points[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, triangles.mean(axis=1) - points.mean(axis=0)) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return Solid(triangles, np.tile(np.array(colour, float), (len(faces), 1)))


def box(centre: tuple[float, float, float], size: tuple[float, float, float], colour: Colour) -> Solid:
    return convex(_BOX_CORNERS * size + centre, _BOX_FACES, colour)


def frustum(
    bottom: tuple[float, float], top: tuple[float, float], z: tuple[float, float], colour: Colour
) -> Solid:
    """A box whose (length, width) changes from `bottom` at z[0] to `top` at z[1]."""
    corners = _BOX_CORNERS.copy()
    upper = corners[:, 2] > 0.0
    corners[:, :2] *= np.where(upper[:, None], top, bottom)
    corners[:, 2] = np.where(upper, z[1], z[0])
    return convex(corners, _BOX_FACES, colour)


def extrusion(profile: list[tuple[float, float]], half_length: float, colour: Colour) -> Solid:
    """A convex (y, z) outline drawn out along x from -half_length to half_length."""
    outline, k = np.array(profile, float), len(profile)
    points = np.concatenate([np.column_stack([np.full(k, x), outline]) for x in (-half_length, half_length)])
    caps = [(base, base + i, base + i + 1) for base in (0, k) for i in range(1, k - 1)]
    sides = [(i, (i + 1) % k, k + i) for i in range(k)]
    sides += [((i + 1) % k, k + (i + 1) % k, k + i) for i in range(k)]
    return convex(points, np.array(caps + sides), colour)


def column(
    radius: float, z: tuple[float, float], colour: Colour, *, top: float | None = None, sides: int = 7
) -> Solid:
    """An upright prism about the z axis; `top` is its upper radius, 0 for a cone."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    fan = np.column_stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)])
    bottom = np.column_stack([radius * ring, np.full(sides, z[0])])
    if top == 0.0:
        points = np.vstack([bottom, (0.0, 0.0, z[1])])
        faces = np.vstack([fan, np.column_stack([i, j, np.full(sides, sides)])])
        return convex(points, faces, colour)
    upper = np.column_stack([(radius if top is None else top) * ring, np.full(sides, z[1])])
    walls = [np.column_stack([i, j, sides + i]), np.column_stack([j, sides + j, sides + i])]
    return convex(np.vstack([bottom, upper]), np.vstack([fan, fan + sides, *walls]), colour)


def wheel(centre: tuple[float, float, float], radius: float, width: float, colour: Colour) -> Solid:
    """A short cylinder with its axle along y, and a lighter hub."""
    lie_down = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
    tyre = column(radius, (-0.5 * width, 0.5 * width), colour, sides=12)
    hub = column(0.5 * radius, (-0.53 * width, 0.53 * width), (150, 150, 146), sides=5)
    return join(tyre, hub).turned(lie_down).moved(*centre)


def ball(
    radius: tuple[float, float, float],
    centre: tuple[float, float, float],
    colour: Colour,
    rng: np.random.Generator | None = None,
    roughness: float = 0.0,
    subdivisions: int = 1,
) -> Solid:
    """An ellipsoid of 20 or 80 faces, dented at random by up to `roughness` of its radius."""
    points, faces = _icosphere(subdivisions)
    if rng is not None:
        points = points * (1.0 - rng.uniform(0.0, roughness, (len(points), 1)))
    return convex(points * radius + centre, faces, colour)


@cache
def _icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.array(sphere.vertices), np.array(sphere.faces)


def panel(
    centre: tuple[float, float, float], normal: tuple[int, int], size: tuple[float, float], colour: Colour
) -> Solid:
    """A flat upright (width, height) rectangle that looks along `normal`, one of ±x, ±y: a door or pane."""
    across = np.array([-normal[1], normal[0], 0.0]) * 0.5 * size[0]
    up = np.array([0.0, 0.0, 0.5 * size[1]])
    a, b, c, d = (np.array(centre) + s * across + t * up for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return Solid(np.array([(a, b, c), (a, c, d)]), np.tile(np.array(colour, float), (2, 1)))
