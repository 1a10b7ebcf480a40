"""Trees, bushes and rocks as low-poly solids, about their final size; `scenes.meshes` makes it exact."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from scenes.catalogue import CATALOGUE, CoverKind
from scenes.solids import Colour, Solid, ball, column, convex, join

BARK: Colour = (104, 80, 58)
CONIFER_GREENS: tuple[Colour, ...] = ((44, 84, 56), (52, 92, 58), (40, 76, 62))
LEAF_GREENS: tuple[Colour, ...] = ((88, 128, 58), (104, 136, 62), (78, 116, 60), (122, 138, 64))
BUSH_GREENS: tuple[Colour, ...] = ((86, 120, 58), (98, 126, 66), (76, 108, 60))
ROCK_GREYS: tuple[Colour, ...] = ((136, 132, 124), (122, 120, 116), (146, 138, 124))

ROOT_DEPTH = 0.5
CONIFER_SLENDERNESS = 2.3


def crown_base(height: float) -> float:
    """Height under the crown of a tree: the Husky and its mast pass below."""
    return min(max(1.3, 0.22 * height), 0.5 * height)


def trunk_radius(length: float) -> float:
    """Radius in metres of the trunk of a tree whose crown is `length` across."""
    return 0.5 * CATALOGUE[CoverKind.TREE].ground_fraction * length


def tree(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """A trunk under its crown: a slender tree is a conifer, a spreading one a broadleaf."""
    base, radius = crown_base(height), trunk_radius(length)
    depth = height - base
    build = _conifer_crown if height > CONIFER_SLENDERNESS * length else _broadleaf_crown
    crown = build(rng, length, width, depth).fitted(length, width, depth).moved(z=base)
    trunk = column(radius, (-ROOT_DEPTH, base + 0.4 * depth), BARK, top=0.6 * radius, sides=6)
    return join(trunk, crown)


def _conifer_crown(rng: np.random.Generator, length: float, width: float, depth: float) -> Solid:
    """Cones stacked upon each other, the lowest from z = 0."""
    colour = CONIFER_GREENS[rng.integers(len(CONIFER_GREENS))]
    tiers = int(np.clip(round(depth / 1.4), 3, 5))
    tier_depth = depth / (0.55 * (tiers - 1) + 1.0)
    parts = []
    for index in range(tiers):
        bottom, share = 0.55 * tier_depth * index, 1.0 - index / tiers
        spread = 0.5 * length * (0.25 + 0.75 * share) * (1.0 if index == 0 else rng.uniform(0.9, 1.05))
        tier = column(spread, (bottom, bottom + tier_depth), colour, top=0.0, sides=8)
        tier = tier.turned(_about_z(rng.uniform(0.0, np.pi))).mottled(rng, 0.08)
        parts.append(tier.shaded(0.82 + 0.05 * index, 1.08 + 0.05 * index))
    return join(*parts)


def _broadleaf_crown(rng: np.random.Generator, length: float, width: float, depth: float) -> Solid:
    """Three leafy balls, the lowest point near z = 0."""
    colour = LEAF_GREENS[rng.integers(len(LEAF_GREENS))]
    bearing = rng.uniform(0.0, 2.0 * np.pi)
    balls = []
    for index, share in enumerate((1.0, 0.78, 0.72)):
        angle, out = bearing + 2.1 * index, 0.0 if index == 0 else 0.26
        up = 0.56 if index == 0 else rng.uniform(0.36, 0.46)
        centre = (out * length * np.cos(angle), out * width * np.sin(angle), up * depth)
        size = (0.40 * share * length, 0.40 * share * width, 0.45 * share * depth)
        balls.append(ball(size, centre, colour, rng, roughness=0.16))
    return join(*balls).mottled(rng, 0.07).shaded(0.72, 1.15)


def bush(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """A clump of three leafy mounds."""
    colour = BUSH_GREENS[rng.integers(len(BUSH_GREENS))]
    bearing = rng.uniform(0.0, 2.0 * np.pi)
    mounds = []
    for index, share in enumerate((1.0, 0.8, 0.66)):
        angle = bearing + 2.2 * index
        out = 0.1 if index == 0 else 0.24
        centre = (out * length * np.cos(angle), out * width * np.sin(angle), 0.42 * share * height)
        size = (0.42 * share * length, 0.42 * share * width, 0.6 * share * height)
        mounds.append(ball(size, centre, colour, rng, roughness=0.22))
    return join(*mounds).mottled(rng, 0.09).shaded(0.66, 1.18)


def rock(rng: np.random.Generator, length: float, width: float, height: float) -> Solid:
    """A faceted boulder, broad at the bottom and sunk into the ground."""
    colour = ROCK_GREYS[rng.integers(len(ROCK_GREYS))]
    count = 26
    bearing = 2.0 * np.pi * (np.arange(count) * 0.618 + rng.uniform(-0.06, 0.06, count))
    rise = np.linspace(-0.35, 1.0, count)
    reach = np.sqrt(np.clip(1.0 - np.clip(rise, 0.0, 1.0) ** 2.6, 0.0, 1.0)) * rng.uniform(0.8, 1.0, count)
    squareness = np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing))) ** -0.6
    points = np.column_stack(
        [reach * squareness * np.cos(bearing), reach * squareness * np.sin(bearing), rise]
    )
    # Low corners, so that it can be seen where it blocks: its footprint is a rectangle.
    corners = [(x, y, z) for x in (-0.84, 0.84) for y in (-0.84, 0.84) for z in (-0.35, 0.35)]
    points = np.vstack([points, corners])
    rise = points[:, 2].copy()
    points[rise > 0.5, :2] += rng.uniform(-0.25, 0.25, 2)
    points *= (0.5 * length, 0.5 * width, 1.0)
    points[:, 2] *= np.where(rise > 0.0, height, 1.0)
    faces = ConvexHull(points).simplices
    return convex(points, faces, colour).mottled(rng, 0.06).shaded(0.8, 1.1)


def _about_z(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([(cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)])
