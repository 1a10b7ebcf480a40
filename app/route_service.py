"""Routes side by side, watchers' places and hiding places for the scenario that is open; the newest request
wins, and while routes are compared they are compared anew after every edit."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from app.changes import Change, StudioError
from app.route_process import Comparison, Situation, compare, hiding_place, watchers
from app.studio import Studio
from planner.covert_route import CovertRoute
from planner.no_route import NoRoute
from planner.vantage import Vantage
from scenes.pose import Pose
from scenes.terrain import Heightmap

log = logging.getLogger(__name__)

MOST_WATCHERS = 8

Answer = TypeVar("Answer")


class RouteService:
    """Lives on the studio's loop; its process is started by the first question."""

    def __init__(self, studio: Studio) -> None:
        self.comparison: Comparison | None = None
        self._studio = studio
        self._pool: ProcessPoolExecutor | None = None
        self._maps: tuple[int, Heightmap] = (0, studio.heightmap)
        self._stale = self._busy = False
        self._leave = studio.subscribe(self._hear)

    @property
    def working(self) -> bool:
        """Whether a comparison is being worked out."""
        return self._busy

    def compare(self) -> None:
        """Compare routes from where the robot is now, and again after every edit, as `Change.ROUTES`."""
        self._stale = True
        if not self._busy:
            self._busy = True
            self._studio.background(self._keep_up())
            self._studio.tell(Change.ROUTES)

    def forget(self) -> None:
        """Compare no longer."""
        self._stale, self.comparison = False, None
        self._studio.tell(Change.ROUTES)

    async def watchers(self, method: str | None, count: int) -> tuple[Vantage, ...]:
        """Where watchers see most of a compared route, or of the shortest. Raises StudioError."""
        if not 1 <= count <= MOST_WATCHERS:
            raise StudioError(f"between 1 and {MOST_WATCHERS} watchers can be placed, got {count}")
        routes = self.comparison.routes if self.comparison is not None else {}
        way = routes[method].points if method in routes else None
        return await self._ask(watchers, way, count)

    async def hiding_place(self) -> CovertRoute:
        """The quickest way to where nobody sees the robot. Raises StudioError."""
        return await self._ask(hiding_place)

    def close(self) -> None:
        """End the process."""
        self._leave()
        self._stale = False
        pool, self._pool = self._pool, None
        if pool is not None:
            for process in (pool._processes or {}).values():
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)

    def _hear(self, change: Change) -> None:
        if change is Change.OPENED:
            self.forget()
        elif change is Change.EDITED and (self.comparison is not None or self._busy):
            self.compare()

    async def _keep_up(self) -> None:
        try:
            while self._stale:
                self._stale = False
                comparison = await self._ask(compare)
                if not self._stale:
                    self.comparison = comparison
        except StudioError as error:
            self._studio.say(str(error))
        finally:
            self._busy = False
            self._studio.tell(Change.ROUTES)

    async def _ask(self, question: Callable[..., Answer], *details) -> Answer:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
        loop = asyncio.get_running_loop()
        try:
            return await loop.run_in_executor(self._pool, question, self._situation(), *details)
        except NoRoute as error:
            raise StudioError(error.reason, 409) from None
        except BrokenProcessPool:
            with contextlib.suppress(Exception):
                self._pool.shutdown(wait=False)
            self._pool = None
            raise StudioError("planning broke off; ask again", 503) from None

    def _situation(self) -> Situation:
        studio = self._studio
        number, heightmap = self._maps
        if heightmap is not studio.heightmap:
            number, heightmap = self._maps = number + 1, studio.heightmap
        scenario, frame = studio.scenario, studio.frame
        start, goal = scenario.start, scenario.goal
        if frame is not None:
            pose, time_s = frame.pose, frame.time_s
        else:
            ground = float(heightmap.height_at(start.x, start.y))
            pose, time_s = Pose(start.x, start.y, ground, yaw=math.radians(start.yaw)), 0.0
        return Situation(
            number, heightmap, scenario.cover, scenario.observers, pose, (goal.x, goal.y), time_s
        )
