"""Putting things on a map so that none touches another, a way, the water, the start or the goal."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy import ndimage

from scenes.catalogue import CATALOGUE, CoverKind, Footprint, SizeRange
from scenes.scenario import CoverObject, CoverSpec, Observer
from scenes.terrain import SURFACE_CODE, Heightmap, Surface

Segment = tuple[tuple[float, float], tuple[float, float]]

START_ROOM = 1.3
GOAL_ROOM = 1.0
EDGE_ROOM = 0.8
CROWN_SHARE = 0.8
RIGID = (CoverKind.DISABLED_VEHICLE, CoverKind.FENCE)
RIGID_DROP = 0.3
TALL = (CoverKind.TREE, CoverKind.COTTAGE, CoverKind.BUILDING, CoverKind.HOUSE)


class Plot:
    """A map that is being furnished; `cover` holds what stands on it so far.

    half : world coordinate of the map's edge
    route : start and goal, which keep their room free of everything
    """

    def __init__(self, half: float, route: Segment) -> None:
        self.half = half
        self.route = np.array(route)
        self.cover: list[CoverObject] = []
        self._outlines: list[Footprint] = []
        self._crowns: list[Footprint] = []
        self._reach = np.zeros((0, 3))
        self._ground: Heightmap | None = None
        self._to_kept_clear = np.zeros((0, 0))

    def keep_clear(self, ground: Heightmap, cells: np.ndarray) -> None:
        """From now on nothing is put on these cells (rows, cols), nor anything rigid on a steep place."""
        self._ground = ground
        self._to_kept_clear = np.asarray(ndimage.distance_transform_edt(~cells, sampling=ground.resolution))

    def put(self, thing: CoverSpec, gap: float = 0.3) -> bool:
        """Add the object, numbered, if it stands free of all others by `gap` metres; says whether it did."""
        outline, crown = thing.footprint, crown_outline(thing)
        if np.abs(crown.corners).max() > self.half - EDGE_ROOM:
            return False
        to_start, to_goal = outline.distance(self.route)
        if to_start < START_ROOM or to_goal < GOAL_ROOM or not self._ground_allows(thing.kind, outline):
            return False
        if self._touches(thing, outline, crown, gap):
            return False
        self.cover.append(CoverObject(id=len(self.cover) + 1, **thing.model_dump()))
        self._outlines.append(outline)
        self._crowns.append(crown)
        self._reach = np.vstack([self._reach, (crown.x, crown.y, crown.radius)])
        return True

    def _ground_allows(self, kind: CoverKind, outline: Footprint) -> bool:
        if self._ground is None:
            return True
        if outline.round:
            return bool(self._to_kept_clear[self._ground.cell(outline.x, outline.y)] > outline.radius + 0.3)
        points = outline.lattice(0.4)
        if (self._to_kept_clear[self._ground.cells(*points.T)] < 0.3).any():
            return False
        return kind not in RIGID or bool(np.ptp(self._ground.height_at(*points.T)) < RIGID_DROP)

    def _touches(self, thing: CoverSpec, outline: Footprint, crown: Footprint, gap: float) -> bool:
        x, y, radius = self._reach.T
        near = np.hypot(x - thing.x, y - thing.y) < radius + crown.radius + gap
        for index in np.flatnonzero(near):
            if thing.kind in TALL and self.cover[index].kind in TALL:
                space = crown.gap(self._crowns[index])
            else:
                space = outline.gap(self._outlines[index])
            if space < gap:
                return True
        return False


def crown_outline(thing: CoverSpec) -> Footprint:
    """The object seen from above: of a tree most of its crown, so that crowns may touch, no more."""
    share = CROWN_SHARE if thing.kind is CoverKind.TREE else 1.0
    length, width = share * thing.length, share * thing.width
    return Footprint(thing.x, thing.y, math.radians(thing.yaw), length, width, CATALOGUE[thing.kind].round)


def draw(
    rng: np.random.Generator, kind: CoverKind, x: float, y: float, yaw: float | None = None
) -> CoverSpec:
    """An object of a random, ordinary size; yaw in degrees, random when left out."""
    entry = CATALOGUE[kind]
    scale = rng.uniform(0.75, 1.3)
    length, height = _scaled(entry.length, scale), _scaled(entry.height, scale * rng.uniform(0.85, 1.2))
    width = length if entry.round else _scaled(entry.width, scale * rng.uniform(0.9, 1.1))
    if kind is CoverKind.TREE:
        height = _scaled(entry.height, rng.uniform(0.75, 1.6))
    turn = rng.uniform(-180.0, 180.0)
    return CoverSpec(
        kind=kind,
        x=round(float(x), 2),
        y=round(float(y), 2),
        yaw=within_half_turn(turn if yaw is None else yaw),
        length=length,
        width=width,
        height=height,
    )


def _scaled(span: SizeRange, factor: float) -> float:
    return round(float(np.clip(factor * span.usual, span.low, span.high)), 2)


def within_half_turn(degrees: float) -> float:
    """The same direction from -180 to 180 degrees, to a tenth."""
    return round(float((degrees + 180.0) % 360.0 - 180.0), 1)


def distance_to_segment(points: np.ndarray, segment: Segment) -> np.ndarray:
    """Metres (n,) from points (n, 2) to the straight line between two ends."""
    a, b = np.array(segment[0]), np.array(segment[1])
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.hypot(*(points - a - share[:, None] * along).T)


def place_observers(
    rng: np.random.Generator, ground: Heightmap, cover: Iterable[CoverSpec], route: Segment, count: int
) -> tuple[Observer, ...]:
    """Watchers on high, dry ground a little off the route, who face its middle."""
    middle = 0.5 * np.sum(route, axis=0)
    half = ground.bounds[1] - 1.0
    points = rng.uniform(-half, half, (400, 2))
    allowed = np.flatnonzero(room_to_watch(ground, cover, route, points))
    height = ground.height_at(*points.T)
    score = (height - ground.heights.mean()) / (ground.heights.std() + 0.2)
    score = score - 0.25 * np.abs(np.hypot(*(points - middle).T) - min(14.0, 0.6 * half))
    score += rng.uniform(0.0, 2.0, len(points))
    chosen: list[np.ndarray] = []
    for place in points[allowed[np.argsort(-score[allowed])]]:
        if len(chosen) < count and all(np.hypot(*(place - other)) > 2.0 for other in chosen):
            chosen.append(place)
    return tuple(watcher(rng, number, place, middle) for number, place in enumerate(chosen, 1))


def room_to_watch(
    ground: Heightmap, cover: Iterable[CoverSpec], route: Segment, points: np.ndarray
) -> np.ndarray:
    """(n,) bool: at which points (n, 2) a watcher may stand, dry, clear of cover and off the route."""
    nowhere = np.full(len(points), np.inf)
    room = np.minimum.reduce([thing.footprint.distance(points) for thing in cover] or [nowhere])
    dry = ground.surface[ground.cells(*points.T)] != SURFACE_CODE[Surface.WATER]
    return dry & (room > 0.8) & (distance_to_segment(points, route) > 2.5)


def watcher(rng: np.random.Generator, number: int, place: np.ndarray, middle: np.ndarray) -> Observer:
    """One who stands at a place (2,) and faces the middle (2,), more or less."""
    bearing = math.degrees(math.atan2(middle[1] - place[1], middle[0] - place[0]))
    return Observer(
        id=number,
        x=round(float(place[0]), 2),
        y=round(float(place[1]), 2),
        yaw=within_half_turn(bearing + rng.uniform(-20.0, 20.0)),
        fov_horizontal=float(rng.choice((90.0, 120.0, 140.0))),
        range=float(rng.integers(40, 61)),
    )
