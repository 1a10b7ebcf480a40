"""From a click's ray to what is under the pointer: a point of the world, and the thing that stands there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.changes import Kind, Selection
from planner.frames import Frame
from scenes.rays import BodyKind, RayScene
from scenes.scenario import CoverObject, Scenario
from scenes.terrain import Heightmap

REACH = 20_000.0
TARGET_RADIUS = 0.45
HAIR = 1e-5
POINTER_SLACK = 0.012
"""How far beside a figure a click still means it, metres for each metre of distance: about eight pixels."""


@dataclass(frozen=True)
class Pick:
    """point : (x, y) where the ray meets the world, None for the sky; thing : what it means, if anything."""

    point: tuple[float, float] | None
    thing: Selection | None


class Picker:
    """Rays against the ground and the cover as they are drawn."""

    def __init__(self) -> None:
        self._rays: RayScene | None = None
        self._heightmap: Heightmap | None = None
        self._cover: tuple[CoverObject, ...] = ()

    def pick(
        self,
        origin: Sequence[float],
        direction: Sequence[float],
        scenario: Scenario,
        heightmap: Heightmap,
        frame: Frame | None,
    ) -> Pick:
        """What a ray from `origin` (3,) along `direction` (3,) meets. Raises ValueError unless finite."""
        start, along = np.asarray(origin, float), np.asarray(direction, float)
        length = float(np.linalg.norm(along)) if along.shape == (3,) else 0.0
        if start.shape != (3,) or not (np.isfinite(start).all() and 0.0 < length < np.inf):
            raise ValueError("a click needs a ray with a finite origin and direction")
        along = along / length
        rays = self.rays(scenario, heightmap)
        hits = rays.cast(start, _bundle(along), REACH)
        hit = int(np.isfinite(hits.distance).argmax())
        distance, body = float(hits.distance[hit]), int(hits.body[hit])
        thing = _nearest_target(start, along, distance, _targets(scenario, heightmap, frame))
        if thing is None and body >= 0 and rays.bodies[body].kind is BodyKind.COVER:
            thing = Selection(Kind.COVER, rays.bodies[body].id)
        if not np.isfinite(distance):
            return Pick(None, thing)
        point = start + distance * along
        return Pick((round(float(point[0]), 3), round(float(point[1]), 3)), thing)

    def adopt(self, rays: RayScene, heightmap: Heightmap, cover: tuple[CoverObject, ...]) -> None:
        """Take over a ray scene of that ground and cover, built on another thread."""
        self._rays, self._heightmap, self._cover = rays, heightmap, cover

    def rays(self, scenario: Scenario, heightmap: Heightmap) -> RayScene:
        """The ground and the cover of the scenario as it is now."""
        if self._rays is None or heightmap is not self._heightmap:
            self._rays = RayScene(heightmap, scenario.cover)
        elif scenario.cover is not self._cover:
            self._rays.set_cover(scenario.cover)
        self._heightmap, self._cover = heightmap, scenario.cover
        return self._rays


def _bundle(along: np.ndarray) -> np.ndarray:
    """(3, 3) the ray and two a hair beside it: one ray alone may slip between two neighbouring triangles."""
    rays = along + HAIR * np.array([(0.0, 0.0, 0.0), (1.0, -0.4, 0.3), (-0.6, 0.8, 0.5)])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _targets(
    scenario: Scenario, heightmap: Heightmap, frame: Frame | None
) -> list[tuple[Selection, np.ndarray]]:
    """The middles of figures and markers, where they are now."""
    time_s = frame.time_s if frame is not None else 0.0
    places = [
        (Selection(Kind.GOAL), scenario.goal.x, scenario.goal.y, 1.0),
        (Selection(Kind.START), scenario.start.x, scenario.start.y, 0.1),
    ]
    for kind, walkers in ((Kind.OBSERVER, scenario.observers), (Kind.OBSTACLE, scenario.obstacles)):
        for walker in walkers:
            x, y, _ = walker.pose_at(time_s)
            places.append((Selection(kind, walker.id), x, y, 0.9))
    return [
        (thing, np.array([x, y, float(heightmap.height_at(x, y)) + lift])) for thing, x, y, lift in places
    ]


def _nearest_target(
    origin: np.ndarray, along: np.ndarray, reach: float, targets: list[tuple[Selection, np.ndarray]]
) -> Selection | None:
    best, best_gap = None, np.inf
    for thing, centre in targets:
        distance = float((centre - origin) @ along)
        gap = float(np.linalg.norm(centre - origin - distance * along))
        if 0.0 < distance < reach + 1.0 and gap < min(best_gap, TARGET_RADIUS + POINTER_SLACK * distance):
            best, best_gap = thing, gap
    return best
