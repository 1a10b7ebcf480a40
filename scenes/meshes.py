"""What stands in a scene: how it looks, where it blocks, and the pose it stands at.

Body frame: origin on the ground at the object's middle, x along its length, z up.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh

from scenes.catalogue import CoverKind
from scenes.figures import observer, person, vehicle
from scenes.pose import Pose
from scenes.scenario import OBSTACLE_SIZES, CoverSpec, ObstacleKind
from scenes.solids import Solid
from scenes.structures import FOUNDATION_DEPTH, POST_DEPTH, building, cottage, fence, house, wreck
from scenes.terrain import Heightmap
from scenes.vegetation import bush, crown_base, rock, tree

Builder = Callable[[np.random.Generator, float, float, float], Solid]

BUILDERS: dict[CoverKind, Builder] = {
    CoverKind.TREE: tree,
    CoverKind.BUSH: bush,
    CoverKind.ROCK: rock,
    CoverKind.COTTAGE: cottage,
    CoverKind.BUILDING: building,
    CoverKind.HOUSE: house,
    CoverKind.DISABLED_VEHICLE: wreck,
    CoverKind.FENCE: fence,
}
FIGURES = {
    "person": (person, OBSTACLE_SIZES[ObstacleKind.PERSON]),
    "vehicle": (vehicle, OBSTACLE_SIZES[ObstacleKind.VEHICLE]),
    "observer": (observer, OBSTACLE_SIZES[ObstacleKind.PERSON]),
}
WITH_FOUNDATION = (CoverKind.COTTAGE, CoverKind.BUILDING, CoverKind.HOUSE)


@dataclass(frozen=True)
class CollisionBox:
    """Body frame, metres: centre (3,) and half extents (3,), sides along the body's axes."""

    center: tuple[float, float, float]
    half_extents: tuple[float, float, float]


@dataclass(frozen=True)
class CollisionCylinder:
    """Body frame, metres: centre (3,), radius and full height, axis along z."""

    center: tuple[float, float, float]
    radius: float
    height: float


@dataclass(frozen=True, eq=False)
class CollisionHull:
    """Body frame, metres: the convex hull of points (n, 3)."""

    points: np.ndarray


CollisionShape = CollisionBox | CollisionCylinder | CollisionHull


def cover_mesh(cover: CoverSpec) -> trimesh.Trimesh:
    """The object with vertex colours; its outer size is length × width × height exactly.

    The shape varies with the object's kind, size and id, so it stays the same when the object is moved.
    """
    length, width, height = cover.size
    label = f"{cover.kind.value} {length:.3f} {width:.3f} {height:.3f} {getattr(cover, 'id', 0)}"
    rng = np.random.default_rng(zlib.crc32(label.encode()))
    return BUILDERS[cover.kind](rng, length, width, height).fitted(length, width, height).mesh()


def walker_mesh(kind: Literal["person", "vehicle", "observer"]) -> trimesh.Trimesh:
    """A figure that faces +x and stands on z = 0, of the size that `scenes.scenario.OBSTACLE_SIZES` gives."""
    build, size = FIGURES[kind]
    return build().fitted(*size).mesh()


def collision_shape(cover: CoverSpec) -> CollisionShape:
    """What a robot runs into: a rock as it looks; else the footprint drawn up from below the ground, of a
    tree the trunk alone."""
    if cover.kind is CoverKind.ROCK:
        return CollisionHull(np.unique(cover_mesh(cover).vertices, axis=0))
    outline = cover.footprint
    top = crown_base(cover.height) if cover.kind is CoverKind.TREE else cover.height
    depth = skirt_depth(cover.kind)
    centre = (0.0, 0.0, 0.5 * (top - depth))
    if outline.round:
        return CollisionCylinder(centre, 0.5 * outline.length, top + depth)
    return CollisionBox(centre, (0.5 * outline.length, 0.5 * outline.width, 0.5 * (top + depth)))


def skirt_depth(kind: CoverKind) -> float:
    """How far the object goes on below its ground, so that it does not float on a slope."""
    return FOUNDATION_DEPTH if kind in WITH_FOUNDATION else POST_DEPTH


def cover_pose(heightmap: Heightmap, cover: CoverSpec) -> Pose:
    """Where the object stands upright: `pose_world_cover` on the mean ground under its outline's corners,
    yet low enough that it floats nowhere."""
    outline = cover.footprint
    x, y = np.vstack([(cover.x, cover.y), outline.corners]).T
    ground = heightmap.height_at(x, y)
    z = min(float(ground.mean()), float(ground.min()) + 0.8 * skirt_depth(cover.kind))
    return Pose(cover.x, cover.y, z, yaw=outline.yaw)
