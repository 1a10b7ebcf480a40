"""Lines of sight among things that stand still: what stops them, and how much light comes through."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numba import njit

from scenes.embree import Part, Tree

SIGHT_MARGIN = 0.01
"""Metres at either end of a line of sight in which nothing hides: the eye and the target touch surfaces."""

FAN = 50
"""Rays for each sheer thing from which on a fan asks the things one by one instead of all at once."""

_STEP = 1e-4  # how far behind a surface, relative to the distance and in metres, a sight line goes on


class _SheerThings:
    """Things that let light through, each in a tree of its own and in an upright cylinder about it."""

    def __init__(self, parts: Sequence[Part]):
        self.trees = [Tree([part], robust=True) for part in parts]
        low, high = (np.array([end(vertices, axis=0) for vertices, _ in parts]) for end in (np.min, np.max))
        self._x, self._y, _ = (0.5 * (low + high)).T
        slack = 1e-3  # the trees are in single precision
        self._radius = slack + np.array(
            [
                np.hypot(vertices[:, 0] - x, vertices[:, 1] - y).max()
                for (vertices, _), x, y in zip(parts, self._x, self._y, strict=True)
            ]
        )
        self._low, self._high = low[:, 2] - slack, high[:, 2] + slack

    def towards(
        self, eye: np.ndarray, bearing: np.ndarray, level: np.ndarray, rise: np.ndarray, length: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which of a fan's rays may meet each thing: their indices, thing after thing, and where those of
        each begin (things + 1,).

        bearing : (n,) ascending, from -pi to pi; level, rise : (n,) lengths of the direction's parts along
        the ground and up; length : (n,) of the rays
        """
        east, north = self._x - eye[0], self._y - eye[1]
        away = np.hypot(east, north)
        inside = away <= self._radius
        half = np.arcsin(np.minimum(self._radius / np.where(inside, self._radius, away), 1.0)) + 1e-6
        middle = np.arctan2(north, east)
        from_, to = middle - half, middle + half
        over_west, over_east = from_ <= -np.pi, to >= np.pi  # the rest of it begins or ends at the other side
        turns = np.empty((len(away), 2, 2))
        turns[:, 0] = np.column_stack([from_, to])
        turns[:, 1] = np.nan
        turns[over_west, 1] = np.column_stack([from_ + 2.0 * np.pi, np.full(len(away), np.inf)])[over_west]
        turns[over_east, 1] = np.column_stack([np.full(len(away), -np.inf), to - 2.0 * np.pi])[over_east]
        turns[inside] = [[-np.inf, np.inf], [np.nan, np.nan]]
        ranges = np.searchsorted(bearing, turns)
        near, far = np.maximum(away - self._radius, 0.0), away + self._radius
        low, high = self._low - eye[2], self._high - eye[2]
        return _towards(ranges, near, far, low, high, level, rise, length)


@njit(cache=True)
def _towards(ranges, near, far, low, high, level, rise, length):
    """The rays of the ranges (things, 2, 2) that get as far as `near` and lie somewhere between the heights
    `low` and `high` above the eye on the way from there to `far`."""
    begins = np.zeros(len(near) + 1, np.int64)
    found = np.empty(0, np.int64)
    for filling in (False, True):
        if filling:
            found = np.empty(begins[-1], np.int64)
        count = 0
        for thing in range(len(near)):
            for turn in range(2):
                for ray in range(ranges[thing, turn, 0], ranges[thing, turn, 1]):
                    first, last = rise[ray] * near[thing], rise[ray] * far[thing]
                    if (
                        level[ray] * length[ray] >= near[thing]
                        and min(first, last) <= high[thing] * level[ray]
                        and max(first, last) >= low[thing] * level[ray]
                    ):
                        if filling:
                            found[count] = ray
                        count += 1
            begins[thing + 1] = count
    return found, begins


class SightTrees:
    """Solid things in one tree, where any hit settles the matter, and what lets light through in another.

    parts : meshes in the world; opacity : share of light that one pass through each of them stops
    """

    def __init__(self, parts: Sequence[Part], opacity: Sequence[float]):
        stops = np.asarray(opacity, float)
        self._solid_parts = [index for index, share in enumerate(stops) if share >= 1.0]
        self._sheer_parts = [index for index, share in enumerate(stops) if share < 1.0]
        self._through = (1.0 - stops[self._sheer_parts]).astype(np.float32)
        self._solid = Tree([parts[index] for index in self._solid_parts], robust=True)
        self._sheer = [parts[index] for index in self._sheer_parts]
        self._sheer_tree = Tree(self._sheer, robust=True)

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
        blocked = self._solid.occluded(*_inner(origins, directions, length))
        light[rays[blocked]] = 0.0
        clear = ~blocked
        rays, directions, length = rays[clear], directions[clear], length[clear]
        if fan and len(rays) > FAN * len(self._sheer) > 0:
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
        directions, length = directions[order], length[order]
        level = np.hypot(directions[:, 0], directions[:, 1])
        things = self._sheer_things
        rays, begins = things.towards(eye, bearing[order], level, directions[:, 2], length)
        lines = _inner(eye, directions, length)
        light = np.ones(len(order), np.float32)
        for index in np.flatnonzero(np.diff(begins)).tolist():
            towards = rays[begins[index] : begins[index + 1]]
            hit = things.trees[index].occluded(*(part[towards] for part in lines))
            light[towards[hit]] *= self._through[index]
        answer = np.empty_like(light)
        answer[order] = light
        return answer

    @cached_property
    def _sheer_things(self) -> _SheerThings:
        return _SheerThings(self._sheer)

    def crossings(
        self, origin: np.ndarray, direction: np.ndarray, length: float
    ) -> tuple[tuple[float, int], ...]:
        """What the ray from origin (3,) passes, nearest first: the distance of its first surface and the
        part's index; a solid one is the last."""
        start = (origin + SIGHT_MARGIN * direction).astype(np.float32)[None]
        reach = np.array([max(length - 2.0 * SIGHT_MARGIN, 0.0)], np.float32)
        hits = self._solid.first_hits(start, direction[None], reach)
        end, solid = length - SIGHT_MARGIN, int(hits.part[0])
        met = []
        if solid >= 0:
            end = float(hits.distance[0]) + SIGHT_MARGIN
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
            hits = self._sheer_tree.first_hits(
                origins[rays] + start[:, None] * directions[rays], directions[rays], end[rays] - start
            )
            hit = hits.part >= 0
            rays, met = rays[hit], start[hit] + hits.distance[hit]
            pairs.append(rays * count + hits.part[hit])
            distances.append(met)
            start = met + _STEP * (1.0 + met)
            ahead = start < end[rays]
            rays, start = rays[ahead], start[ahead]
        pair, first = np.unique(np.concatenate(pairs), return_index=True)
        ray, part = np.divmod(pair, max(count, 1))
        return ray, part, np.concatenate(distances)[first]


def _inner(
    origins: np.ndarray, directions: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays without their margins: starts and directions (n, 3), lengths (n,)."""
    starts = (origins + SIGHT_MARGIN * directions).astype(np.float32)
    return starts, directions.astype(np.float32), (length - 2.0 * SIGHT_MARGIN).astype(np.float32)
