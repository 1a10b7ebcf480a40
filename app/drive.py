"""The present mission as the server sees it: follows the mission process and stores each finished run."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.changes import Change
from app.mission_process import Progress
from app.store import Store, StoreError
from app.timeline import Timeline
from app.wording import listed
from app.workers import MissionWorker
from planner.exposure_log import NOTICEABLE
from planner.frames import Frame, Perception, Status
from scenes.scenario import Scenario

log = logging.getLogger(__name__)

DRIVES_ON = (Status.REACHED, Status.TIMEOUT, Status.STUCK, Status.UNREACHABLE)  # at a new goal


class Drive:
    """Owns the mission process and what it last reported; lives on the event loop's thread.

    tell : called with each change; background : runs a coroutine and keeps hold of it
    """

    def __init__(
        self,
        store: Store,
        tell: Callable[..., None],
        background: Callable[[Coroutine], None],
    ) -> None:
        self.frame: Frame | None = None
        self.status = Status.IDLE
        self.message, self.error = "getting ready", None
        self.real_factor = 0.0
        self.summary: dict[str, Any] | None = None
        self.timeline = Timeline()
        self._store, self._tell, self._background = store, tell, background
        self._rows: list[tuple[float, ...]] = []
        self._started_at = datetime.now(UTC)
        self._scenario: Scenario | None = None
        self._scenario_id = ""
        self._generation = 0
        self._inbox: list[tuple[Progress, bool]] = []
        self._inbox_lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self.worker = MissionWorker(self._hear, self._hear_refusal, self._hear_death)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.worker.start()

    def load(
        self,
        scenario: Scenario,
        scenario_id: str,
        method: str,
        seed: int,
        perception: Perception,
        playing: bool = False,
        weights: Path | None = None,
    ) -> None:
        """Begin a mission from its start, the learned method with weights of a training where given."""
        self.finish(Status.STOPPED)
        self.frame, self.error, self.real_factor, self.summary = None, None, 0.0, None
        self.timeline.clear()
        self.status = Status.RUNNING if playing else Status.IDLE
        self.message = "getting ready"
        self._started_at = datetime.now(UTC)
        self._scenario, self._scenario_id = scenario, scenario_id
        self._generation = self.worker.load(scenario, method, seed, perception, playing, weights)
        self._tell(Change.STATUS)

    def edit(self, scenario: Scenario, changed: tuple[str, ...]) -> None:
        """Hand edited fields to the mission; a new goal sets a robot that has arrived going again."""
        self._scenario = scenario
        goal_set = "goal" in changed
        self.worker.edit(scenario, changed, goal_set=goal_set)
        if goal_set and self.status in DRIVES_ON:
            self.become(Status.RUNNING)

    def become(self, status: Status) -> None:
        """What an order just given will bring about, said at once."""
        self.status = status
        self.error = None if status is Status.RUNNING else self.error
        self.message = self._in_words()
        self._tell(Change.STATUS)

    def say(self, message: str) -> None:
        """Show a sentence until the next report replaces it."""
        self.message = message
        self._tell(Change.STATUS)

    def finish(self, status: Status) -> None:
        """Store the run so far, where there is one."""
        rows, self._rows = self._rows, []
        if not rows or self.summary is None or self._scenario is None:
            return
        summary = self.summary | {"status": status.value, "success": status is Status.REACHED}
        record = (self._scenario_id, self._scenario, summary, rows, self._started_at)
        self._started_at = datetime.now(UTC)

        async def store() -> None:
            try:
                await asyncio.to_thread(self._store.add_run, *record)
            except StoreError as error:
                self.say(str(error))

        self._background(store())

    # what the mission process says, heard on its watching thread

    def _hear(self, report: Progress, current: bool) -> None:
        with self._inbox_lock:
            self._inbox.append((report, current))
            if len(self._inbox) > 1:
                return  # one is on its way already and will take this report along
        self._on_loop(self._take_reports)

    def _hear_refusal(self, reason: str) -> None:
        self._on_loop(self.say, reason)

    def _hear_death(self, reason: str, restoring: bool) -> None:
        self._on_loop(self._mourn, reason, restoring)

    def _on_loop(self, callback: Callable, *args) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(callback, *args)

    def _take_reports(self) -> None:
        with self._inbox_lock:
            reports, self._inbox = self._inbox, []
        changed = None
        for report, current in reports:
            if report.generation != self._generation:
                continue
            self._rows.extend(report.rows)
            self.timeline.extend(report.rows)
            self.summary = report.summary or self.summary
            if current and report.status.final:
                self.finish(report.status)
            changed = report, current
        if changed is not None:
            self._follow(*changed)

    def _follow(self, report: Progress, current: bool) -> None:
        before, said = (self.status, self.error), self.message
        if current:
            self.status, self.real_factor = report.status, report.real_factor
            if report.status is Status.RUNNING:
                self.error = None
        if report.frame is not None:
            self.frame = report.frame
        self.message = self._in_words()
        if report.frame is not None:
            self._tell(Change.FRAME)
        words = report.frame is None and self.message != said  # else they go with the frame
        if words or before != (self.status, self.error):
            self._tell(Change.STATUS)

    def _mourn(self, reason: str, restoring: bool) -> None:
        self.real_factor = 0.0
        if restoring:
            self.status = Status.PAUSED
            self.error = f"the simulation {reason}; its last state is being restored, press play to go on"
        else:
            self.status = Status.STOPPED
            self.error = f"the simulation {reason} again and again; reset to start anew"
        self.message = self.error
        log.error(self.error)
        self._tell(Change.STATUS)

    def _in_words(self) -> str:
        if self.error is not None:
            return self.error
        match self.status:
            case Status.IDLE:
                return "ready: press play to drive to the goal"
            case Status.PAUSED:
                return "paused"
        words = (self.frame.message if self.frame is not None else "") or self.status.value.replace("_", " ")
        watchers = self._watchers()
        return f"{words}, seen by {watchers}" if watchers and self.status is Status.RUNNING else words

    def _watchers(self) -> str:
        """Who sees the robot now, in words; empty while nobody does."""
        if self.frame is None or self._scenario is None:
            return ""
        names = {observer.id: observer.name for observer in self._scenario.observers}
        seeing = [
            names.get(watch.observer_id) or f"observer {watch.observer_id}"
            for watch in self.frame.exposure.watches
            if watch.fraction > NOTICEABLE
        ]
        return listed(seeing) if seeing else ""
