"""Exposure fields of a scene that changes bit by bit: what an observer sees is kept until the observer, the
cover or somebody who walks has moved, so that dragging one of two hundred costs that one's field alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from planner.belief import Belief
from planner.exposure import (
    ExposureField,
    View,
    common_cycle,
    exposure_field,
    time_averaged,
    views_at,
)
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import CoverObject, MovingObstacle, Observer
from scenes.terrain import Heightmap

LARGEST = 320  # cells a side
QUICK_RAYS = 100_000
"""Lines of sight that take no longer than a person's hand notices."""
AT_A_TIME = 4  # observers between two looks at whether the answer is still wanted
AVERAGED_RAYS = 4_000_000
BELIEF_SEED = 0


@dataclass(frozen=True)
class Moment:
    """What exposure depends on; `time_s` is 0 where nothing walks."""

    heightmap: Heightmap
    cover: tuple[CoverObject, ...]
    obstacles: tuple[MovingObstacle, ...]
    observers: tuple[Observer, ...]
    time_s: float

    @property
    def finest(self) -> int:
        """Stride at which a field has at most `LARGEST` cells a side."""
        return math.ceil(max(self.heightmap.shape) / LARGEST)


class Over(StrEnum):
    """What a field is of: the moment, the mean over the patrols' beats, or what observers not yet seen may
    see on the mean, by the belief over where they stand."""

    NOW = "now"
    BEATS = "beats"
    BELIEF = "belief"


@dataclass(frozen=True)
class Search:
    """What a belief rests on: the robot's way, and the poses from which it has looked about."""

    start: tuple[float, float]
    goal: tuple[float, float]
    poses: tuple[Pose, ...]


class ExposureFields:
    """Lives on one thread."""

    def __init__(self) -> None:
        self._rays: RayScene | None = None
        self._scene: tuple = ()
        self._kept: dict[int, dict[View, np.ndarray]] = {}
        self._blank: dict[int, ExposureField] = {}
        self._averaged: tuple[object, ExposureField] | None = None
        self._belief: tuple[object, Belief, int] | None = None

    def rays(self, moment: Moment) -> RayScene:
        """The moment's ray scene; only what has changed is built anew."""
        walking = any(obstacle.patrol for obstacle in moment.obstacles)
        scene = (moment.cover, moment.obstacles, moment.time_s if walking else 0.0)
        rays = self._rays
        if rays is None or rays.heightmap is not moment.heightmap:
            self._rays = rays = RayScene(moment.heightmap, moment.cover)
            self._blank.clear()
        elif self._scene == scene:
            return rays
        elif self._scene[0] != moment.cover:
            rays.set_cover(moment.cover)
        rays.set_walkers(moment.obstacles, (), moment.time_s)
        self._scene = scene
        self._kept.clear()
        return rays

    def strides(self, moment: Moment) -> tuple[int, ...]:
        """First a coarse one, where the sharp field would take long, then the sharp one."""
        self.rays(moment)
        finest = moment.finest
        known = self._kept.get(finest, {})
        new = sum(view not in known for view in views_at(moment.observers, moment.heightmap, moment.time_s))
        rays = new * moment.heightmap.heights.size / finest**2
        if rays <= QUICK_RAYS:
            return (finest,)
        coarse = finest * min(max(2, math.ceil(math.sqrt(rays / QUICK_RAYS))), 8)
        return coarse, finest

    def now(
        self, moment: Moment, stride: int, overtaken: Callable[[], bool] = lambda: False
    ) -> ExposureField | None:
        """Who sees each `stride`-th cell at the moment; None as soon as the answer is overtaken."""
        rays, heightmap = self.rays(moment), moment.heightmap
        kept = self._kept.setdefault(stride, {})
        views = views_at(moment.observers, heightmap, moment.time_s)
        new = [view for view in views if view not in kept]
        for group in (new[at : at + AT_A_TIME] for at in range(0, len(new), AT_A_TIME)):
            if overtaken():
                return None
            kept |= zip(group, exposure_field(rays, heightmap, group, stride=stride).seen, strict=True)
        self._kept[stride] = {view: kept[view] for view in views}
        if stride not in self._blank:
            self._blank[stride] = exposure_field(rays, heightmap, (), stride=stride)
        blank = self._blank[stride]
        seen = np.stack([kept[view] for view in views]) if views else blank.seen
        ids = tuple(view.observer_id for view in views)
        field = ExposureField(blank.x_min, blank.y_min, blank.resolution, ids, seen, blank.unknown)
        _ = field.united  # worked out here and kept: the event loop is to find it ready
        return field

    def averaged(self, moment: Moment, stride: int) -> ExposureField:
        """The mean over the patrols' common cycle, past those who walk in the way as they are now."""
        rays = self.rays(moment)
        question = (moment.observers, self._scene, stride, id(moment.heightmap))
        if self._averaged is None or self._averaged[0] != question:
            field = time_averaged(rays, moment.heightmap, moment.observers, stride=stride)
            self._averaged = question, field
        return self._averaged[1]

    def believed(self, moment: Moment, stride: int, search: Search) -> ExposureField:
        """The chance that an observer who has not been seen yet sees a robot in each cell."""
        rays, way = self.rays(moment), (search.start, search.goal)
        question = (id(moment.heightmap), moment.cover, way)
        if self._belief is None or self._belief[0] != question or self._belief[2] > len(search.poses):
            rng = np.random.default_rng(BELIEF_SEED)
            belief = Belief(rays, moment.heightmap, moment.cover, way, rng)
            self._belief = question, belief, 0
        _, belief, looked = self._belief
        for pose in search.poses[looked:]:
            belief.look(pose)
        self._belief = question, belief, len(search.poses)
        blank = exposure_field(rays, moment.heightmap, (), stride=stride)
        return replace(blank, joint=belief.exposure(stride=stride))

    def affordable(self, moment: Moment) -> int:
        """Stride at which the mean over the beats takes about a second."""
        looks = sum(24 if observer.patrol else 1 for observer in moment.observers)
        if not common_cycle(moment.observers):
            return moment.finest
        rays = looks * moment.heightmap.heights.size
        return max(moment.finest, min(math.ceil(math.sqrt(rays / AVERAGED_RAYS)), 8))
