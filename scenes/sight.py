"""Lines of sight among things that stand still: what stops them, and how much light comes through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.embree import Part, build_tree

SIGHT_MARGIN = 0.01
"""Metres at either end of a line of sight in which nothing hides: the eye and the target touch surfaces."""

_STEP = 1e-4  # how far behind a surface, relative to the distance and in metres, a sight line goes on


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
        self._sheer = build_tree([parts[index] for index in self._sheer_parts], robust=True)

    def light(self, origins: np.ndarray, directions: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(n,) float32 share of light that comes through along rays from origins (n, 3)."""
        light = np.ones(len(origins), np.float32)
        rays = np.flatnonzero(length > 2.0 * SIGHT_MARGIN)
        if len(rays):
            blocked = self._solid.run(
                (origins[rays] + SIGHT_MARGIN * directions[rays]).astype(np.float32),
                directions[rays].astype(np.float32),
                dists=(length[rays] - 2.0 * SIGHT_MARGIN).astype(np.float32),
                query="OCCLUDED",
            )
            light[rays[blocked >= 0]] = 0.0
            rays = rays[blocked < 0]
        ray, part, _ = self._passed(origins[rays], directions[rays], length[rays] - SIGHT_MARGIN)
        np.multiply.at(light, rays[ray], self._through[part])
        return light

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
            answer = self._sheer.run(
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
