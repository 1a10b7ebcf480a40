"""How far the robot truly is from cover, and whether that cover stands in somebody's line of sight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.line_of_sight import View, VisibleFraction
from scenes.catalogue import CATALOGUE
from scenes.pose import Pose
from scenes.rays import BodyKind, RayScene
from scenes.robot import HUSKY
from scenes.scenario import CoverObject
from scenes.terrain import Heightmap

_MIDDLE = np.array([[0.0, 0.0, 0.5 * HUSKY.height]])


@dataclass(frozen=True)
class Shelter:
    """`distance` metres from the robot's middle to the surface of the nearest cover that stands between it
    and an observer, inf where none does; `hidden`, the share of the robot that those who have it in their
    field of view do not see, 0 where nobody has."""

    distance: float = math.inf
    hidden: float = 0.0


class CoverGround:
    """The cover objects of a map that can hide a Husky, and the distances to them."""

    def __init__(self, heightmap: Heightmap, cover: Sequence[CoverObject]):
        able = [
            thing
            for thing in cover
            if CATALOGUE[thing.kind].conceals(
                max(thing.length, thing.width), thing.height, HUSKY.width, HUSKY.height
            )
        ]
        outlines = [thing.footprint for thing in able]
        places = np.array([(thing.x, thing.y) for thing in able]).reshape(-1, 2)
        self._row = {thing.id: row for row, thing in enumerate(able)}
        self._centres = np.column_stack([places, heightmap.height_at(*places.T)])
        self._turn = np.array([(math.cos(o.yaw), math.sin(o.yaw)) for o in outlines]).reshape(-1, 2)
        self._half = 0.5 * np.array([(o.length, o.length if o.round else o.width) for o in outlines]).reshape(
            -1, 2
        )
        self._round = np.array([o.round for o in outlines], bool)

    def centre_distance(self, pose: Pose) -> float:
        """Metres to the nearest object's centre on the ground, in three dimensions; inf without any."""
        return float(np.linalg.norm(self._centres - pose.position, axis=1).min(initial=math.inf))

    def surface_distance(self, pose: Pose) -> float:
        """Metres over the ground to the nearest object's outline, negative inside; inf without any."""
        return float(self._surfaces(pose).min(initial=math.inf))

    def _surfaces(self, pose: Pose) -> np.ndarray:
        """(n,) as `scenes.catalogue.Footprint.distance`."""
        offset = (pose.x, pose.y) - self._centres[:, :2]
        cos, sin = self._turn.T
        along = np.abs(cos * offset[:, 0] + sin * offset[:, 1]) - self._half[:, 0]
        across = np.abs(cos * offset[:, 1] - sin * offset[:, 0]) - self._half[:, 1]
        outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        square = outside + np.minimum(np.maximum(along, across), 0.0)
        return np.where(self._round, np.hypot(*offset.T) - self._half[:, 0], square)

    def shelter(self, rays: RayScene, views: Sequence[View], seen: VisibleFraction, pose: Pose) -> Shelter:
        """What stands between the robot and those who look its way.

        seen : of a robot at `pose` by `views`
        """
        middle = pose.to_world(_MIDDLE)
        watching = [
            (view, share) for view, share in zip(views, seen.each, strict=True) if view.holds(middle)[0]
        ]
        if not watching:
            return Shelter()
        blocking = {
            crossing.body.id
            for view, share in watching
            if share < 1.0
            for crossing in rays.crossings(view.eye, middle[0])
            if crossing.body.kind is BodyKind.COVER and crossing.body.id in self._row
        }
        rows = [self._row[key] for key in sorted(blocking)]
        distance = float(self._surfaces(pose)[rows].min(initial=math.inf))
        return Shelter(distance, 1.0 - seen.united)
