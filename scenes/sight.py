"""Lines of sight among things that stand still: what stops them, and how much light comes through."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from embreex.rtcore_scene import EmbreeScene

from scenes.embree import Part, build_tree

SIGHT_MARGIN = 0.01
"""Metres at either end of a line of sight in which nothing hides: the eye and the target touch surfaces."""

FAN = 50
"""Rays for each sheer thing from which on a fan asks the things one by one instead of all at once."""

_STEP = 1e-4  # how far behind a surface, relative to the distance and in metres, a sight line goes on


@dataclass(frozen=True, eq=False)
class _SheerThing:
    """A thing that lets light through, in an upright cylinder about it."""

    tree: EmbreeScene
    x: float
    y: float
    radius: float
    low: float
    high: float

    @classmethod
    def of(cls, part: Part) -> _SheerThing:
        vertices = np.asarray(part[0], float)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        x, y, _ = 0.5 * (low + high)
        radius = np.hypot(vertices[:, 0] - x, vertices[:, 1] - y).max()
        slack = 1e-3  # the trees are in single precision
        return cls(
            build_tree([part], robust=True),
            x, y, float(radius) + slack, float(low[2]) - slack, float(high[2]) + slack,
        )  # fmt: skip

    def bearings(self, eye: np.ndarray, bearing: np.ndarray) -> list[tuple[int, int]]:
        """Ranges of the ascending bearings (n,) in -pi to pi that lead from the eye to the cylinder."""
        east, north = self.x - eye[0], self.y - eye[1]
        away = float(np.hypot(east, north))
        if away <= self.radius:
            return [(0, len(bearing))]
        middle, half = math.atan2(north, east), math.asin(self.radius / away) + 1e-6
        turns = [(middle - half, middle + half)]
        if middle - half <= -math.pi:
            turns.append((middle - half + 2.0 * math.pi, math.inf))
        if middle + half >= math.pi:
            turns.append((-math.inf, middle + half - 2.0 * math.pi))
        return [(int(begin), int(end)) for begin, end in np.searchsorted(bearing, turns)]

    def towards(
        self, eye: np.ndarray, level: np.ndarray, rise: np.ndarray, length: np.ndarray
    ) -> np.ndarray:
        """Which of the rays in the bearings above reach the cylinder at its height; `level` and `rise` are
        the lengths of the direction's parts along the ground and up."""
        away = float(np.hypot(self.x - eye[0], self.y - eye[1]))
        near, far = max(away - self.radius, 0.0), away + self.radius
        low, high = self.low - eye[2], self.high - eye[2]
        reaches = level * length >= near
        # between `near` and `far` a straight ray is within [low, high] somewhere
        over = np.minimum(rise * near, rise * far) > high * level
        under = np.maximum(rise * near, rise * far) < low * level
        return np.flatnonzero(reaches & ~over & ~under)


class SightTrees:
    """Solid things in one tree, where any hit settles the matter, and what lets light through in another.

    parts : meshes in the world; opacity : share of light that one pass through each of them stops
    """

    def __init__(self, parts: Sequence[Part], opacity: Sequence[float]):
        stops = np.asarray(opacity, float)
        self._solid_parts = [index for index, share in enumerate(stops) if share >= 1.0]
        self._sheer_parts = [index for index, share in enumerate(stops) if share < 1.0]
        self._through = (1.0 - stops[self._sheer_parts]).astype(np.float32)
        self._solid = build_tree([parts[index] for index in self._solid_parts], robust=True)
        self._sheer = [parts[index] for index in self._sheer_parts]
        self._sheer_tree = build_tree(self._sheer, robust=True)

    def light(self, origins: np.ndarray, directions: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(n,) float32 share of light that comes through along rays from origins (n, 3), or (3,) for a fan of
        rays from one eye, which is faster where they are many."""
        light = np.ones(len(directions), np.float32)
        rays = np.flatnonzero(length > 2.0 * SIGHT_MARGIN)
        if not len(rays):
            return light
        directions, length = directions[rays], length[rays]
        fan = origins.ndim == 1
        origins = origins if fan else origins[rays]
        blocked = _occluded(self._solid, origins, directions, length)
        light[rays[blocked]] = 0.0
        clear = ~blocked
        rays, directions, length = rays[clear], directions[clear], length[clear]
        if fan and len(rays) > FAN * len(self._sheer):
            light[rays] = self._through_fan(origins, directions, length)
        else:
            starts = np.broadcast_to(origins, directions.shape) if fan else origins[clear]
            ray, part, _ = self._passed(starts, directions, length - SIGHT_MARGIN)
            np.multiply.at(light, rays[ray], self._through[part])
        return light

    def _through_fan(self, eye: np.ndarray, directions: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(n,) light of rays from one eye that nothing solid stops: each sheer thing is asked about the rays
        towards it alone."""
        bearing = np.arctan2(directions[:, 1], directions[:, 0])
        order = np.argsort(bearing)
        bearing, directions, length = bearing[order], directions[order], length[order]
        level = np.hypot(directions[:, 0], directions[:, 1])
        light = np.ones(len(order), np.float32)
        for thing, through in zip(self._sheer_things, self._through, strict=True):
            for begin, end in thing.bearings(eye, bearing):
                part = slice(begin, end)
                towards = begin + thing.towards(eye, level[part], directions[part, 2], length[part])
                if len(towards):
                    hit = _occluded(thing.tree, eye, directions[towards], length[towards])
                    light[towards[hit]] *= through
        answer = np.empty_like(light)
        answer[order] = light
        return answer

    @cached_property
    def _sheer_things(self) -> tuple[_SheerThing, ...]:
        return tuple(_SheerThing.of(part) for part in self._sheer)

    def crossings(
        self, origin: np.ndarray, direction: np.ndarray, length: float
    ) -> tuple[tuple[float, int], ...]:
        """What the ray from origin (3,) passes, nearest first: the distance of its first surface and the
        part's index; a solid one is the last."""
        start = (origin + SIGHT_MARGIN * direction).astype(np.float32)[None]
        reach = np.array([max(length - 2.0 * SIGHT_MARGIN, 0.0)], np.float32)
        answer = self._solid.run(start, direction.astype(np.float32)[None], dists=reach, output=1)
        end, solid = length - SIGHT_MARGIN, int(answer["geomID"][0])
        met = []
        if solid >= 0:
            end = float(answer["tfar"][0]) + SIGHT_MARGIN
            met.append((end, self._solid_parts[solid]))
        _, part, distance = self._passed(origin[None], direction[None], np.array([end]))
        met += [(float(d), self._sheer_parts[p]) for p, d in zip(part, distance, strict=True)]
        return tuple(sorted(met))

    def _passed(
        self, origins: np.ndarray, directions: np.ndarray, end: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays and sheer parts that meet before `end` (n,), each pair once, and the distance of its first
        surface."""
        count = len(self._sheer_parts)
        rays = np.flatnonzero(end > SIGHT_MARGIN) if count else np.zeros(0, np.int64)
        start = np.full(len(rays), SIGHT_MARGIN)
        pairs, distances = [np.zeros(0, np.int64)], [np.zeros(0)]
        while len(rays):
            answer = self._sheer_tree.run(
                (origins[rays] + start[:, None] * directions[rays]).astype(np.float32),
                directions[rays].astype(np.float32),
                dists=(end[rays] - start).astype(np.float32),
                output=1,
            )
            hit = answer["geomID"] >= 0
            rays, met = rays[hit], start[hit] + answer["tfar"][hit]
            pairs.append(rays * count + answer["geomID"][hit])
            distances.append(met)
            start = met + _STEP * (1.0 + met)
            ahead = start < end[rays]
            rays, start = rays[ahead], start[ahead]
        pair, first = np.unique(np.concatenate(pairs), return_index=True)
        ray, part = np.divmod(pair, max(count, 1))
        return ray, part, np.concatenate(distances)[first]


def _occluded(
    tree: EmbreeScene, origins: np.ndarray, directions: np.ndarray, length: np.ndarray
) -> np.ndarray:
    """(n,) bool: whether anything in the tree lies on the ray, margins aside; origins (n, 3) or (3,)."""
    answer = tree.run(
        (origins + SIGHT_MARGIN * directions).astype(np.float32),
        directions.astype(np.float32),
        dists=(length - 2.0 * SIGHT_MARGIN).astype(np.float32),
        query="OCCLUDED",
    )
    return answer >= 0
