"""Exposure of the scenario that is open, computed beside the event loop.

Of the requests that wait for their turn each gets what holds when it is its turn, so that the newest wins
and what has been overtaken is never computed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from app.changes import StudioError
from app.studio import Studio
from planner.exposure import (
    ExposureField,
    SightProfile,
    exposure_field,
    sight_profile,
    time_averaged,
    views_at,
)
from scenes.rays import RayScene
from scenes.scenario import CoverObject, MovingObstacle, Observer
from scenes.terrain import Heightmap

Answer = TypeVar("Answer")

SAMPLES, LEAST_SAMPLES = 24, 4
"""Times at which the patrols' cycle is looked at."""

FULLY_SAMPLED = 8
"""Patrols up to which all of these times are taken; with more of them fewer, so that nobody waits long."""


@dataclass(frozen=True)
class Moment:
    """What exposure depends on; `time_s` is 0 where nothing walks."""

    heightmap: Heightmap
    cover: tuple[CoverObject, ...]
    obstacles: tuple[MovingObstacle, ...]
    observers: tuple[Observer, ...]
    time_s: float

    @classmethod
    def of(cls, studio: Studio) -> Moment:
        scenario, frame = studio.scenario, studio.frame
        walking = any(thing.patrol for thing in (*scenario.observers, *scenario.obstacles))
        time_s = frame.time_s if walking and frame is not None else 0.0
        return cls(studio.heightmap, scenario.cover, scenario.obstacles, scenario.observers, time_s)


class ExposureService:
    """Answers questions about the studio's scenario as it is; call it on the event loop's thread."""

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._turn = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, "exposure")  # one: a request that is given up still runs on
        self._rays: RayScene | None = None
        self._cover: tuple[CoverObject, ...] = ()
        self._kept: dict[bool, tuple[Moment, int, ExposureField]] = {}

    async def field(self, stride: int = 1, *, averaged: bool = False) -> ExposureField:
        """Who sees each `stride`-th cell now, or on the mean over the patrols' beats."""
        async with self._turn:
            moment = Moment.of(self._studio)
            kept = self._kept.get(averaged)
            if kept is None or kept[:2] != (moment, stride):
                field = await self._beside(lambda: self._compute(moment, stride, averaged))
                self._kept[averaged] = kept = (moment, stride, field)
            return kept[2]

    async def profile(self, observer_id: int, x: float, y: float) -> SightProfile:
        """The line from an observer to a robot at (x, y). Raises StudioError."""
        reason = self._studio.off_the_map(x, y)
        if reason is not None:
            raise StudioError(f"the place {reason}")

        def answer(moment: Moment, rays: RayScene) -> SightProfile:
            for view in views_at(moment.observers, moment.heightmap, moment.time_s):
                if view.observer_id == observer_id:
                    return sight_profile(rays, moment.heightmap, view, x, y)
            raise StudioError(f"there is no observer {observer_id}", 404)

        return await self.ask(answer)

    async def ask(self, question: Callable[[Moment, RayScene], Answer]) -> Answer:
        """Put a question to the present moment and its ray scene, on the service's own thread."""
        async with self._turn:
            moment = Moment.of(self._studio)
            return await self._beside(lambda: question(moment, self._scene(moment)))

    def close(self) -> None:
        """End the thread once it is done with what it has begun."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _beside(self, work: Callable[[], Answer]) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)

    def _compute(self, moment: Moment, stride: int, averaged: bool) -> ExposureField:
        rays = self._scene(moment)
        if averaged:
            walking = sum(observer.patrol is not None for observer in moment.observers)
            samples = max(LEAST_SAMPLES, min(SAMPLES, SAMPLES * FULLY_SAMPLED // max(walking, 1)))
            return time_averaged(rays, moment.heightmap, moment.observers, samples=samples, stride=stride)
        views = views_at(moment.observers, moment.heightmap, moment.time_s)
        return exposure_field(rays, moment.heightmap, views, stride=stride)

    def _scene(self, moment: Moment) -> RayScene:
        """The ray scene of the moment; only what has changed is built anew."""
        rays = self._rays
        if rays is None or rays.heightmap is not moment.heightmap:
            self._rays = rays = RayScene(moment.heightmap, moment.cover)
        elif self._cover != moment.cover:
            rays.set_cover(moment.cover)
        self._cover = moment.cover
        rays.set_walkers(moment.obstacles, (), moment.time_s)
        return rays
