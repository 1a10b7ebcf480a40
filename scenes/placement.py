"""Putting things on a map so that none touches another, a way, the water, the start or the goal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from scenes.catalogue import CATALOGUE, CoverKind, Footprint, SizeRange
from scenes.scenario import CoverObject, Observer
from scenes.terrain import Heightmap, Surface

START_ROOM = 1.3
GOAL_ROOM = 1.0
EDGE_ROOM = 0.8
WITH_CROWN = 0.8
WALLED = (CoverKind.COTTAGE, CoverKind.BUILDING, CoverKind.HOUSE)

Segment = tuple[tuple[float, float], tuple[float, float]]


class Plot:
    """A map that is being furnished.

    start, goal : (x, y) that keep their room free of everything
    half : world coordinate of the map's edge
    """

    def __init__(self, half: float, start: tuple[float, float], goal: tuple[float, float]) -> None:
        self.half = half
        self.start = start
        self.goal = goal
        self.cover: list[CoverObject] = []
        self._outlines: list[Footprint] = []
        self._crowns: list[Footprint] = []
        self._reach: list[tuple[float, float, float]] = []
        self._free: Heightmap | None = None
        self._distance: np.ndarray | None = None

    def keep_clear(self, heightmap: Heightmap, cells: np.ndarray) -> None:
        """From now on nothing is put on these cells (rows, cols) of the map."""
        self._free = heightmap
        self._distance = np.asarray(
            ndimage.distance_transform_edt(~cells, sampling=heightmap.resolution)
        )

    def put(self, thing: CoverObject, gap: float = 0.3) -> bool:
        """Add the object if it stands free of all others by `gap` metres; says whether it did."""
        outline, crown = thing.footprint, body_outline(thing)
        if not (self._inside(crown) and self._leaves_room(outline) and self._on_free_ground(outline)):
            return False
        if self._touches(thing, outline, crown, gap):
            return False
        self.cover.append(thing)
        self._outlines.append(outline)
        self._crowns.append(crown)
        self._reach.append((thing.x, thing.y, crown.radius))
        return True

    def _inside(self, crown: Footprint) -> bool:
        return max(abs(crown.x), abs(crown.y)) + crown.radius < self.half - EDGE_ROOM or (
            np.abs(crown.corners).max() < self.half - EDGE_ROOM
        )

    def _leaves_room(self, outline: Footprint) -> bool:
        start, goal = outline.distance(np.array([self.start, self.goal]))
        return start >= START_ROOM and goal >= GOAL_ROOM

    def _on_free_ground(self, outline: Footprint) -> bool:
        if self._free is None or self._distance is None:
            return True
        if outline.round:
            return bool(self._distance[self._free.cell(outline.x, outline.y)] > outline.radius + 0.2)
        u, v = np.meshgrid(*(np.linspace(0.0, 1.0, max(2, math.ceil(s / 0.4) + 1)) for s in (outline.length, outline.width)))
        origin, east, north = outline.corners[2], outline.corners[3], outline.corners[1]
        points = origin + u.reshape(-1, 1) * (east - origin) + v.reshape(-1, 1) * (north - origin)
        return all(self._distance[self._free.cell(x, y)] > 0.3 for x, y in points)

    def _touches(self, thing: CoverObject, outline: Footprint, crown: Footprint, gap: float) -> bool:
        if not self.cover:
            return False
        x, y, radius = np.array(self._reach).T
        near = np.hypot(x - thing.x, y - thing.y) < radius + crown.radius + gap
        for index in np.flatnonzero(near):
            other = self.cover[index]
            tall = _tall(thing.kind) and _tall(other.kind)
            a, b = (crown, self._crowns[index]) if tall else (outline, self._outlines[index])
            if a.gap(b) < gap:
                return True
        return False


def body_outline(thing: CoverObject) -> Footprint:
    """The object seen from above: for a tree most of its crown, so that crowns may touch, no more."""
    length, width = thing.length or 0.0, thing.width or 0.0
    share = WITH_CROWN if thing.kind is CoverKind.TREE else 1.0
    return Footprint(
        thing.x, thing.y, math.radians(thing.yaw), share * length, share * width, CATALOGUE[thing.kind].round
    )


def _tall(kind: CoverKind) -> bool:
    return kind is CoverKind.TREE or kind in WALLED


def draw(
    rng: np.random.Generator, kind: CoverKind, number: int, x: float, y: float, yaw: float | None = None
) -> CoverObject:
    """An object of a random, ordinary size; yaw in degrees, random when left out."""
    entry = CATALOGUE[kind]
    scale = rng.uniform(0.75, 1.3)
    length, height = _scaled(entry.length, scale), _scaled(entry.height, scale * rng.uniform(0.85, 1.2))
    width = length if entry.round else _scaled(entry.width, scale * rng.uniform(0.9, 1.1))
    if kind is CoverKind.TREE:
        height = _scaled(entry.height, rng.uniform(0.75, 1.6))
    return CoverObject(
        id=number,
        kind=kind,
        x=round(x, 2),
        y=round(y, 2),
        yaw=round(float(rng.uniform(-180.0, 180.0)) if yaw is None else yaw, 1),
        length=length,
        width=width,
        height=height,
    )


def _scaled(span: SizeRange, factor: float) -> float:
    return round(float(np.clip(factor * span.usual, span.low, span.high)), 2)


def distance_to_segment(points: np.ndarray, segment: Segment) -> np.ndarray:
    """Metres (n,) from points (n, 2) to the straight line between two ends."""
    a, b = np.array(segment[0]), np.array(segment[1])
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.hypot(*(points - a - share[:, None] * along).T)


def place_observers(
    rng: np.random.Generator, heightmap: Heightmap, cover: Sequence[CoverObject], route: Segment, count: int
) -> tuple[Observer, ...]:
    """Watchers on high, dry ground a little off the route, who face its middle."""
    middle = 0.5 * (np.array(route[0]) + np.array(route[1]))
    half = heightmap.bounds[1] - 1.0
    points = rng.uniform(-half, half, (400, 2))
    off_route = distance_to_segment(points, route)
    dry = np.array([heightmap.surface_at(x, y) is not Surface.WATER for x, y in points])
    room = np.full(len(points), np.inf)
    for thing in cover:
        room = np.minimum(room, thing.footprint.distance(points))
    allowed = np.flatnonzero(dry & (room > 0.8) & (off_route > 2.5))
    distance = np.hypot(*(points - middle).T)
    height = heightmap.height_at(points[:, 0], points[:, 1])
    score = (height - heightmap.heights.mean()) / (heightmap.heights.std() + 0.2)
    score = score - 0.25 * np.abs(distance - min(14.0, 0.6 * half)) + rng.uniform(0.0, 2.0, len(points))
    chosen: list[int] = []
    for index in allowed[np.argsort(-score[allowed])]:
        if len(chosen) == count:
            break
        if all(np.hypot(*(points[index] - points[other])) > 2.0 for other in chosen):
            chosen.append(int(index))
    return tuple(_watcher(rng, number, points[index], middle) for number, index in enumerate(chosen, 1))


def _watcher(rng: np.random.Generator, number: int, at: np.ndarray, middle: np.ndarray) -> Observer:
    facing = math.degrees(math.atan2(middle[1] - at[1], middle[0] - at[0])) + rng.uniform(-20.0, 20.0)
    return Observer(
        id=number,
        x=round(float(at[0]), 2),
        y=round(float(at[1]), 2),
        yaw=round((facing + 180.0) % 360.0 - 180.0, 1),
        fov_horizontal=float(rng.choice((90.0, 120.0, 140.0))),
        range=float(rng.integers(40, 61)),
    )
