"""Exposure of the scenario that is open, computed beside the event loop.

Of the requests that wait for their turn each gets what holds when it is its turn, so that the newest wins
and what has been overtaken is never computed. Where somebody follows the exposure it is computed anew after
every change, coarse first where the sharp result takes longer, and told as `Change.EXPOSURE`.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from app.changes import Change, StudioError
from app.exposure_fields import ExposureFields, Moment, Over, Search
from app.studio import Studio
from planner.exposure import ExposureField, SightProfile, sight_profile, views_at
from planner.frames import Status
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.terrain import Heightmap

log = logging.getLogger(__name__)

MOTION_PERIOD_S = 0.8  # between pictures of what walks
MOTION_STRIDE = BELIEF_STRIDE = 2
LOOK_EVERY = 1.0  # metres driven between looks that a belief heeds

Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class Picture:
    """Who sees what, as last computed.

    edits : how many edits of the studio it heeds; sharp : whether every cell was looked at
    over : the moment, the mean over the patrols' beats, or the belief over observers not yet seen
    """

    field: ExposureField
    heightmap: Heightmap
    edits: int
    sharp: bool
    over: Over = Over.NOW


def present(studio: Studio) -> Moment:
    """What the exposure of the scenario depends on now."""
    scenario, frame = studio.scenario, studio.frame
    time_s = frame.time_s if walking(studio) and frame is not None else 0.0
    return Moment(studio.heightmap, scenario.cover, scenario.obstacles, scenario.observers, time_s)


def walking(studio: Studio) -> bool:
    """Whether anybody in the scenario walks."""
    return any(thing.patrol for thing in (*studio.scenario.observers, *studio.scenario.obstacles))


class ExposureService:
    """Answers questions about the studio's scenario as it is; call it on the event loop's thread."""

    def __init__(self, studio: Studio) -> None:
        self.picture: Picture | None = None
        self._studio = studio
        self._turn = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, "exposure")  # one: a request that is given up still runs on
        self._fields = ExposureFields()
        self._over = Over.NOW
        self._looks: list[Pose] = []
        self._stale = self._busy = False
        self._motion_due: asyncio.TimerHandle | None = None
        self._leave: Callable[[], None] | None = None

    # asked

    async def field(self, stride: int = 1, *, averaged: bool = False) -> ExposureField:
        """Who sees each `stride`-th cell now, or on the mean over the patrols' beats."""
        make = self._fields.averaged if averaged else self._fields.now
        async with self._turn:
            moment = present(self._studio)
            field = await self._beside(lambda: make(moment, stride))
        assert field is not None  # nothing overtakes it
        return field

    async def profile(self, observer_id: int, x: float, y: float) -> SightProfile:
        """The line from an observer to a robot at (x, y). Raises StudioError."""
        profiles = await self.profiles(x, y, only=observer_id)
        if not profiles:
            raise StudioError(f"there is no observer {observer_id}", 404)
        return profiles[0]

    async def profiles(self, x: float, y: float, only: int | None = None) -> tuple[SightProfile, ...]:
        """The lines from all observers, or one, to a robot at (x, y). Raises StudioError."""
        reason = self._studio.off_the_map(x, y)
        if reason is not None:
            raise StudioError(f"the place {reason}")

        def answer(moment: Moment, rays: RayScene) -> tuple[SightProfile, ...]:
            views = views_at(moment.observers, moment.heightmap, moment.time_s)
            return tuple(
                sight_profile(rays, moment.heightmap, view, x, y)
                for view in views
                if only in (None, view.observer_id)
            )

        return await self.ask(answer)

    async def ask(self, question: Callable[[Moment, RayScene], Answer]) -> Answer:
        """Put a question to the present moment and its ray scene, on the service's own thread."""
        async with self._turn:
            moment = present(self._studio)
            return await self._beside(lambda: question(moment, self._fields.rays(moment)))

    # following

    def follow(self, following: bool = True) -> None:
        """Keep `picture` up to date from now on, or no longer."""
        if following and self._leave is None:
            self._leave = self._studio.subscribe(self._hear)
            self._wake()
        elif not following and self._leave is not None:
            self._leave()
            self._leave, self._stale = None, False

    def show(self, over: Over) -> None:
        """What `picture` shall be of."""
        if over is not self._over:
            self._over = over
            if self._leave is not None:
                self._wake()

    def close(self) -> None:
        """Stop following; end the thread once it is done with what it has begun."""
        self.follow(False)
        if self._motion_due is not None:
            self._motion_due.cancel()
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _hear(self, change: Change) -> None:
        if change in (Change.OPENED, Change.EDITED):
            self._wake()
        elif change in (Change.FRAME, Change.STATUS):
            moved = self._look_about() and self._over is Over.BELIEF
            if moved or (self._over is Over.NOW and walking(self._studio)):
                self._hear_motion()

    def _look_about(self) -> bool:
        """Note from where the robot has looked about; whether that is another place than the last."""
        frame = self._studio.frame
        if frame is None or frame.tick == 0:
            self._looks.clear()
            return False
        pose = frame.pose
        if self._looks and math.dist((pose.x, pose.y), (self._looks[-1].x, self._looks[-1].y)) < LOOK_EVERY:
            return False
        self._looks.append(pose)
        return True

    def _hear_motion(self) -> None:
        if self._motion_due is None:
            self._motion_due = asyncio.get_running_loop().call_later(MOTION_PERIOD_S, self._motion)

    def _motion(self) -> None:
        self._motion_due = None
        if self._leave is not None:
            self._wake()

    def _wake(self) -> None:
        self._stale = True
        if not self._busy:
            self._busy = True
            self._studio.background(self._keep_up())

    async def _keep_up(self) -> None:
        try:
            while self._stale:
                self._stale = False
                await self._compute()
        except asyncio.CancelledError:
            raise
        except Exception:
            log.exception("the exposure could not be computed")
        finally:
            self._busy = False

    async def _compute(self) -> None:
        studio, over = self._studio, self._over
        async with self._turn:
            moment, edits = present(studio), studio.edits
            strides = await self._beside(lambda: self._strides(moment, over))
            for stride in strides:
                # the first one is never given up: a hand that keeps moving would see nothing
                wanted = stride == strides[0]
                field = await self._beside(lambda: self._answer(moment, stride, over, wanted))  # noqa: B023
                if field is None or studio.heightmap is not moment.heightmap:
                    return
                self.picture = Picture(field, moment.heightmap, edits, stride == moment.finest, over)
                studio.tell(Change.EXPOSURE)
                if self._stale:
                    return

    def _strides(self, moment: Moment, over: Over) -> tuple[int, ...]:
        if over is Over.BELIEF:
            return (BELIEF_STRIDE * moment.finest,)
        if over is Over.BEATS:
            return (self._fields.affordable(moment),)
        if moment.time_s and self._studio.status is Status.RUNNING:
            return (MOTION_STRIDE * moment.finest,)
        return self._fields.strides(moment)

    def _answer(self, moment: Moment, stride: int, over: Over, wanted: bool) -> ExposureField | None:
        if over is Over.BEATS:
            return self._fields.averaged(moment, stride)
        if over is Over.BELIEF:
            start, goal = self._studio.scenario.start, self._studio.scenario.goal
            search = Search((start.x, start.y), (goal.x, goal.y), tuple(self._looks))
            return self._fields.believed(moment, stride, search)
        return self._fields.now(moment, stride, lambda: self._stale and not wanted)

    async def _beside(self, work: Callable[[], Answer]) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)
