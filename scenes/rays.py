"""One ray engine for lidar, camera and line of sight: Embree over the terrain, the cover and the walkers.

Metres, world frame. Embree works in single precision: distances are good to about 1e-6 of the largest
coordinate. Everything here is deterministic: the same scene and rays give the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Literal

import numpy as np
import trimesh
from numba import njit
from trimesh.visual import ColorVisuals

from scenes.catalogue import CATALOGUE
from scenes.embree import FirstHits, Part, Tree
from scenes.meshes import cover_mesh, cover_pose, walker_mesh
from scenes.pose import Pose
from scenes.scenario import CoverObject, MovingObstacle, Observer
from scenes.sight import SIGHT_MARGIN, SightTrees
from scenes.terrain import Heightmap


class BodyKind(StrEnum):
    TERRAIN = "terrain"
    COVER = "cover"
    OBSTACLE = "obstacle"
    OBSERVER = "observer"


WALKER_CLASS_ID = {"person": 8, "vehicle": 9, "observer": 10}
"""Class ids of figures, after those of `scenes.catalogue`."""

GROUND_CLASS_ID = -1


@dataclass(frozen=True)
class Body:
    """Something a ray can hit; `index` is its label in hits, `id` the thing's own in the scenario.

    opacity : share of a sight line's light that one pass through the body stops
    """

    index: int
    kind: BodyKind
    id: int
    class_id: int
    class_name: str
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Hits:
    """The first thing on each of n rays.

    distance : (n,) float32 metres, inf where nothing was hit within range
    body : (n,) int32 index into `RayScene.bodies`, -1 for a miss
    triangle : (n,) int32 face of that body's mesh, -1 for a miss
    normal : (n, 3) float32 along the face's outward normal, not of unit length; zeros for a miss
    """

    distance: np.ndarray
    body: np.ndarray
    triangle: np.ndarray
    normal: np.ndarray


@dataclass(frozen=True)
class Crossing:
    """A line of sight meets a body, `distance` metres from the eye."""

    body: Body
    distance: float


class _Figure:
    """A walker's mesh in its own frame, with the sphere about it that spares most rays the query."""

    def __init__(self, kind: Literal["person", "vehicle", "observer"]):
        mesh = walker_mesh(kind)
        self.tree = Tree([(mesh.vertices, mesh.faces)])
        self.colours = _face_colours(mesh)
        self.centre = mesh.bounds.mean(axis=0)
        self.radius = float(np.linalg.norm(mesh.vertices - self.centre, axis=1).max())


@dataclass(frozen=True)
class _Walker:
    body: Body
    figure: _Figure
    pose: Pose


class RayScene:
    """The scenario's world as rays see it.

    Terrain and cover lie in one static tree, built anew when cover changes. Walkers keep a tree for each
    kind of figure, into whose frame the rays are carried, so that moving them costs nothing.
    """

    def __init__(self, heightmap: Heightmap, cover: Sequence[CoverObject] = ()):
        self.heightmap = heightmap
        self._ground = heightmap.triangles()
        self._figures: dict[str, _Figure] = {}
        self._walkers: tuple[_Walker, ...] = ()
        self.set_cover(cover)

    def set_cover(self, cover: Sequence[CoverObject]) -> None:
        """Replace all cover objects."""
        bodies = [Body(0, BodyKind.TERRAIN, 0, GROUND_CLASS_ID, "ground")]
        self._parts: list[Part] = [self._ground]
        self._colours: list[np.ndarray] = [np.zeros((0, 3), np.uint8)]
        for thing in cover:
            entry = CATALOGUE[thing.kind]
            bodies.append(
                Body(len(bodies), BodyKind.COVER, thing.id, entry.class_id, entry.class_name, entry.opacity)
            )
            mesh = cover_mesh(thing)
            vertices = cover_pose(self.heightmap, thing).to_world(np.asarray(mesh.vertices))
            self._parts.append((vertices, mesh.faces))
            self._colours.append(_face_colours(mesh))
        self._static = tuple(bodies)
        self._tree = Tree(self._parts)
        self.__dict__.pop("_sight", None)
        self._rename_walkers()

    def set_walkers(
        self,
        obstacles: Sequence[MovingObstacle] = (),
        observers: Sequence[Observer] = (),
        time_s: float = 0.0,
    ) -> None:
        """Put the figures of moving obstacles and observers where their beats have them at `time_s`."""
        walkers = []
        for kind, things in ((BodyKind.OBSTACLE, obstacles), (BodyKind.OBSERVER, observers)):
            for thing in things:
                name = thing.kind.value if isinstance(thing, MovingObstacle) else "observer"
                if name not in self._figures:
                    self._figures[name] = _Figure(name)
                x, y, yaw = thing.pose_at(time_s)
                pose = Pose(x, y, float(self.heightmap.height_at(x, y)), yaw=yaw)
                body = Body(0, kind, thing.id, WALKER_CLASS_ID[name], name)
                walkers.append(_Walker(body, self._figures[name], pose))
        self._walkers = tuple(walkers)
        self._rename_walkers()

    def _rename_walkers(self) -> None:
        first = len(self._static)
        self._walkers = tuple(
            _Walker(replace(walker.body, index=first + offset), walker.figure, walker.pose)
            for offset, walker in enumerate(self._walkers)
        )
        self.__dict__.pop("colours", None)
        self.bodies = self._static + tuple(walker.body for walker in self._walkers)

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_range: float,
        order: np.ndarray | None = None,
    ) -> Hits:
        """The first hit along each ray.

        origins : (n, 3), or (3,) for rays that start in one point; directions : (n, 3) of unit length
        order : (n,) indices of the rays in an order in which neighbours point alike, where theirs is not
            such: that is faster; see `scenes.embree.Tree.first_hits`
        Surfaces are hit from both sides, so a ray that starts inside a thing hits it on its way out.
        """
        directions = np.ascontiguousarray(directions, np.float32)
        origins = np.ascontiguousarray(origins, np.float32)
        reach = np.full(len(directions), max_range, np.float32)
        distance, body, triangle, normal = self._tree.first_hits(origins, directions, reach, order)
        for walker in self._walkers:
            rays, found = _cast_at(walker, origins, directions, distance)
            distance[rays], body[rays] = found.distance, walker.body.index
            triangle[rays] = found.triangle
            normal[rays] = found.normal @ walker.pose.rotation.T.astype(np.float32)
        distance[body < 0] = np.inf
        return Hits(distance, body, triangle, normal)

    @property
    def walkers(self) -> tuple[Body, ...]:
        """The figures among the bodies."""
        return self.bodies[len(self._static) :]

    @cached_property
    def colours(self) -> tuple[np.ndarray, np.ndarray]:
        """Where each body's faces begin (bodies,) in a table (m, 3) uint8 of their colours. The ground has
        none: see its surface map."""
        tables = [*self._colours, *(walker.figure.colours for walker in self._walkers)]
        starts = np.cumsum([0, *(len(table) for table in tables[:-1])])
        return starts, np.concatenate(tables)

    @cached_property
    def _sight(self) -> SightTrees:
        return SightTrees(self._parts, [body.opacity for body in self._static])

    def visible(self, origins: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """(n,) float32 share of light from 0 to 1 that comes through from targets (n, 3) to eyes (n, 3).

        The ground and solid things stop all of it; trees, bushes and fences let 1 - opacity through, once
        an object however many of its surfaces the line crosses. Figures of observers never hide: an eye is
        inside its own. Within `SIGHT_MARGIN` of either end nothing hides.
        """
        one_eye = np.ndim(origins) == 1
        origins, directions, length = _lines(origins, targets)
        light = self._sight.light(origins[0] if one_eye and len(origins) else origins, directions, length)
        lit = np.flatnonzero(light)
        light[lit[self._behind_obstacles(origins[lit], directions[lit], length[lit])[0]]] = 0.0
        return light

    def crossings(self, origin: np.ndarray, target: np.ndarray) -> tuple[Crossing, ...]:
        """What lies between an eye (3,) and a target (3,), nearest first, up to the first thing that stops
        all light; by the rules of `visible`."""
        origins, directions, length = _lines(origin, target)
        met = [
            Crossing(self._static[index], distance)
            for distance, index in self._sight.crossings(origins[0], directions[0], float(length[0]))
        ]
        hidden, body, distance = self._behind_obstacles(origins, directions, length)
        if len(hidden):
            met.append(Crossing(self.bodies[body[0]], float(distance[0])))
        met.sort(key=lambda crossing: crossing.distance)
        solid = [index for index, crossing in enumerate(met) if crossing.body.opacity >= 1.0]
        return tuple(met[: solid[0] + 1] if solid else met)

    def _behind_obstacles(
        self, origins: np.ndarray, directions: np.ndarray, length: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Indices of the rays that moving obstacles stop, the nearest's body index and its distance."""
        starts = (origins + SIGHT_MARGIN * directions).astype(np.float32)
        reach = np.maximum(length - 2.0 * SIGHT_MARGIN, 0.0).astype(np.float32)
        body = np.full(len(origins), -1)
        for walker in self._walkers:
            if walker.body.kind is BodyKind.OBSTACLE:
                rays, found = _cast_at(walker, starts, directions.astype(np.float32), reach)
                reach[rays], body[rays] = found.distance, walker.body.index
        hidden = np.flatnonzero(body >= 0)
        return hidden, body[hidden], reach[hidden] + SIGHT_MARGIN


def _lines(origins: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins (n, 3), unit directions (n, 3) and lengths (n,) of lines from eyes to targets."""
    starts, ends = np.broadcast_arrays(np.atleast_2d(origins).astype(float), np.atleast_2d(targets))
    offset = ends - starts
    length = np.sqrt(np.einsum("ij,ij->i", offset, offset))
    return starts, offset / np.where(length > 0.0, length, 1.0)[:, None], length


def _face_colours(mesh: trimesh.Trimesh) -> np.ndarray:
    visual = mesh.visual
    assert isinstance(visual, ColorVisuals)  # as scenes.meshes makes them
    return np.asarray(visual.face_colors)[:, :3].astype(np.uint8)


def _cast_at(walker: _Walker, origins, directions, reach) -> tuple[np.ndarray, FirstHits]:
    """Indices of the rays that hit the walker before `reach`, and what they hit.

    origins : (n, 3), or (3,) for all"""
    rotation = walker.pose.rotation.astype(np.float32)
    centre = walker.pose.to_world(walker.figure.centre)
    rays = near_sphere(np.atleast_2d(origins), directions, reach, centre, walker.figure.radius)
    origin = np.broadcast_to(origins, directions.shape)[rays]
    origin = (origin - walker.pose.position.astype(np.float32)) @ rotation
    found = walker.figure.tree.first_hits(origin, directions[rays] @ rotation, reach[rays])
    hit = found.part >= 0
    return rays[hit], FirstHits(*(answers[hit] for answers in found))


@njit(cache=True)
def near_sphere(origins, directions, reach, centre, radius):
    """Ascending indices of the rays that may meet what a sphere holds before their `reach` (n,) ends.

    centre : (3,); origins : (n, 3), or (1, 3) for all; directions : (n, 3) of unit length"""
    single = len(origins) == 1
    found = np.empty(len(directions), np.intp)
    count, largest = 0, 1.01 * radius * radius
    x = y = z = square = 0.0
    for i in range(len(directions)):
        if i == 0 or not single:
            x, y, z = (
                centre[0] - np.float64(origins[i, 0]),
                centre[1] - np.float64(origins[i, 1]),
                centre[2] - np.float64(origins[i, 2]),
            )
            square = x * x + y * y + z * z
        along = x * directions[i, 0] + y * directions[i, 1] + z * directions[i, 2]
        if -radius < along < reach[i] + radius and square - along * along < largest:
            found[count] = i
            count += 1
    return found[:count]
