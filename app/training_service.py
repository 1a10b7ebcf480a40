"""The owner of all trainings: one at a time learns in a process of its own, supervised; every one is on
record and can be gone on with.

Lives on the studio's loop. What changes is told as `Change.TRAINING`; where the robot of a training drives
and what it sees goes to those who `watch`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from typing import Any, TypeVar

from app.changes import Change, StudioError
from app.store import StoreError, UnknownEntry
from app.studio import Studio
from app.training_plan import Task, TrainingPlan, TrainingStatus
from app.training_process import Done, Drawn, Ended, Moved, Order, Started, train
from app.training_records import Training, TrainingRecords, logged_episodes
from app.training_sight import Sight
from app.training_trial import Driver, Trial, adopt_policy, drive
from app.workers import how_it_ended
from planner.episode import check_ground, check_reachable
from planner.learning_errors import PolicyError

log = logging.getLogger(__name__)

METHOD = "covernav_paper"
STOPPING_LIMIT_S = 20.0

View = Drawn | Moved | Sight
Answer = TypeVar("Answer")


@dataclass
class _Running:
    training: Training
    process: Any
    pipe: connection.Connection
    over: asyncio.Event
    ended: Ended | None = None


@dataclass(frozen=True)
class Compared:
    """Two checkpoints on the same mission."""

    training: int
    before: str
    after: str
    driver: Driver
    trials: tuple[Trial, Trial]


class TrainingService:
    """Raises StoreError where the workspace's records cannot be read."""

    def __init__(self, studio: Studio) -> None:
        self.compared: Compared | None = None
        self._studio = studio
        self._records = TrainingRecords(studio.store.workspace)
        self._trainings = {training.id: training for training in self._records.load()}
        self._running: _Running | None = None
        self._watchers: list[Callable[[View], None]] = []
        self._writer = ThreadPoolExecutor(1, "training-records")  # one: records are written in order
        self._pool: ProcessPoolExecutor | None = None
        self._context = multiprocessing.get_context("spawn")
        self._leave = studio.subscribe(self._hear_change)
        self._closing = False
        self._beginning = asyncio.Lock()

    # what there is

    @property
    def trainings(self) -> list[Training]:
        """Oldest first."""
        return list(self._trainings.values())

    @property
    def live(self) -> Training | None:
        """The one that a process is at work on."""
        return self._running.training if self._running is not None else None

    def training(self, training_id: int) -> Training:
        """Raises UnknownEntry."""
        if training_id not in self._trainings:
            raise UnknownEntry(f"there is no training {training_id}")
        return self._trainings[training_id]

    def watch(self, watcher: Callable[[View], None]) -> Callable[[], None]:
        """Hand on where the robot of the training drives and what it sees; returns what ends that."""
        self._watchers.append(watcher)
        return lambda: self._watchers.remove(watcher) if watcher in self._watchers else None

    # orders

    async def start(self, plan: TrainingPlan) -> Training:
        """Begin a training, of the scenario that is open where the plan is about one.

        Raises StudioError, 409 while another is under way; ScenarioError where it has no reachable goal;
        StoreError."""
        if plan.task is Task.CURRICULUM and plan.steps is not None:
            raise StudioError("steps: the curriculum has them for each stage; leave them out")
        async with self._beginning:
            self._refuse_a_second()
            about, document = "", None
            if plan.task is not Task.CURRICULUM:
                scenario = self._studio.scenario
                check = check_reachable if plan.task is Task.MISSION else check_ground
                await asyncio.to_thread(check, scenario)
                about, document = scenario.name, await asyncio.to_thread(scenario.to_json)
            training = await self._written(self._records.add, plan, about)
            self._trainings[training.id] = training
            self._begin(training, document)
            return training

    def resume(self, training_id: int) -> Training:
        """Go on after a pause, or from the last checkpoint. Raises StudioError, UnknownEntry."""
        training = self.training(training_id)
        if training.status is TrainingStatus.PAUSED:
            self._order(training, Order.RESUME, TrainingStatus.RUNNING)
            return training
        if training.status is TrainingStatus.DONE:
            raise StudioError(f"{training.called} is complete", 409)
        if self._beginning.locked():
            raise StudioError("another training is just beginning: stop it first, one learns at a time", 409)
        self._refuse_a_second()
        if training.plan.task is not Task.CURRICULUM and not (training.folder / "settings.json").is_file():
            raise StudioError(f"{training.called} ended before it began; start a new one", 409)
        self._begin(training, None)
        return training

    def pause(self, training_id: int) -> Training:
        """Hold after the step that is being driven. Raises StudioError, UnknownEntry."""
        training = self.training(training_id)
        if training.status is TrainingStatus.PAUSED:
            return training
        if training.status is not TrainingStatus.RUNNING:
            raise StudioError(f"{training.called} is {training.status}, not running", 409)
        self._order(training, Order.PAUSE, TrainingStatus.PAUSED)
        return training

    def stop(self, training_id: int) -> Training:
        """End it; what it has finished can be gone on with. Raises StudioError, UnknownEntry."""
        training = self.training(training_id)
        if not training.status.live:
            raise StudioError(f"{training.called} is {training.status} already", 409)
        if training.status is not TrainingStatus.STOPPING:
            self._order(training, Order.STOP, TrainingStatus.STOPPING)
        return training

    async def delete(self, training_id: int) -> None:
        """Stop it, forget it and remove its checkpoints. Raises UnknownEntry, StoreError."""
        training, running = self.training(training_id), self._running
        if running is not None and running.training is training:
            running.process.terminate()
            await running.over.wait()
        self._trainings.pop(training_id, None)
        if self.compared is not None and self.compared.training == training_id:
            self.compared = None
        self._studio.tell(Change.TRAINING)
        await self._written(self._records.delete, training_id)

    async def use(self, training_id: int, checkpoint: str) -> None:
        """Put a checkpoint into the running mission. Raises UnknownEntry, StudioError for one that cannot be
        used."""
        path = self.training(training_id).checkpoint(checkpoint)
        kept = await self._ask(adopt_policy, path, self._studio.store.workspace / "policies", training_id)
        self._studio.set_method(METHOD, kept)

    async def compare(self, training_id: int, before: str, after: str, driver: Driver) -> Compared:
        """Drive the open scenario once with each of two checkpoints. Raises UnknownEntry, StudioError."""
        training, studio = self.training(training_id), self._studio
        paths = [training.checkpoint(name) for name in (before, after)]
        scenario, seed = studio.scenario, studio.seed
        trials = [await self._ask(drive, scenario, path, driver, seed) for path in paths]
        if studio.scenario is not scenario or training_id not in self._trainings:
            raise StudioError("the scene or the training has changed meanwhile; compare again", 409)
        self.compared = Compared(training_id, before, after, driver, (trials[0], trials[1]))
        self._studio.tell(Change.TRAINING)
        return self.compared

    def forget_comparison(self) -> None:
        if self.compared is not None:
            self.compared = None
            self._studio.tell(Change.TRAINING)

    async def close(self) -> None:
        """End the processes; what is under way is found again as interrupted."""
        self._closing = True
        self._leave()
        running, pool, self._pool = self._running, self._pool, None
        if pool is not None:
            for process in (pool._processes or {}).values():
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)
        if running is not None:
            running.process.terminate()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(running.over.wait(), 3.0)
        await asyncio.to_thread(self._writer.shutdown)

    def _refuse_a_second(self) -> None:
        if self._running is not None:
            other = self._running.training
            raise StudioError(f"{other.called} is {other.status}: stop it first, one learns at a time", 409)

    def _order(self, training: Training, order: Order, status: TrainingStatus) -> None:
        running = self._running
        if running is not None and running.training is training:
            if order is Order.STOP and training.status is TrainingStatus.STARTING:
                running.process.terminate()  # there is nothing to lose yet
            with contextlib.suppress(OSError):  # it has just ended, which is about to be heard
                running.pipe.send(order)
            if order is Order.STOP:
                asyncio.get_running_loop().call_later(STOPPING_LIMIT_S, self._insist, running)
        self._become(training, status)

    def _insist(self, running: _Running) -> None:
        if self._running is running:
            running.process.kill()

    # the process

    def _begin(self, training: Training, document: str | None) -> None:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=train, args=(theirs, ours, training.plan, training.folder, document),
            name="covernav-training",
        )  # fmt: skip
        process.start()
        theirs.close()
        running = self._running = _Running(training, process, ours, asyncio.Event())
        loop = asyncio.get_running_loop()
        threading.Thread(
            target=self._listen, args=(loop, running), name="training-watch", daemon=True
        ).start()
        self._become(training, TrainingStatus.STARTING)

    def _listen(self, loop: asyncio.AbstractEventLoop, running: _Running) -> None:
        """On a thread of its own: pass on what the process says until it ends."""
        with contextlib.suppress(RuntimeError):  # the loop has been closed
            try:
                while True:
                    loop.call_soon_threadsafe(self._hear, running, running.pipe.recv())
            except (EOFError, OSError):
                running.process.join()
                rows = logged_episodes(running.training.folder)
                loop.call_soon_threadsafe(self._bury, running, rows)

    def _hear(self, running: _Running, report: Any) -> None:
        training = running.training
        match report:
            case Started():
                if training.status is TrainingStatus.STARTING:
                    self._become(training, TrainingStatus.RUNNING)
            case Done(row):
                training.episodes.append(row)
                self._record(self._records.add_episodes, training.id, [row])
                self._studio.tell(Change.TRAINING)
            case Ended():
                running.ended = report
            case _:
                for watcher in tuple(self._watchers):
                    watcher(report)

    def _bury(self, running: _Running, rows: list[dict[str, Any]]) -> None:
        """The process is gone; `rows` are the episodes that it has logged."""
        training, self._running = running.training, None
        running.pipe.close()
        if len(rows) > len(training.episodes):
            training.episodes = rows
            self._record(self._records.add_episodes, training.id, rows)
        if not self._closing:
            self._become(training, *self._outcome(running))
        running.over.set()

    def _outcome(self, running: _Running) -> tuple[TrainingStatus, str]:
        training, ended = running.training, running.ended
        if ended is not None and ended.reason:
            return TrainingStatus.FAILED, _without(self._studio.store.workspace, ended.reason)
        if ended is not None and ended.complete:
            return TrainingStatus.DONE, ""
        if ended is not None or training.status is TrainingStatus.STOPPING:
            return TrainingStatus.STOPPED, ""
        how = how_it_ended(running.process.exitcode)
        words = f"the training {how}; resume goes on after episode {len(training.episodes)}"
        log.error(words)
        return TrainingStatus.INTERRUPTED, words

    def _become(self, training: Training, status: TrainingStatus, message: str = "") -> None:
        training.status, training.message = status, message
        if training.id in self._trainings:
            self._record(self._records.set_status, training.id, status, message)
            self._studio.tell(Change.TRAINING)

    def _hear_change(self, change: Change) -> None:
        if change in (Change.OPENED, Change.EDITED):
            self.forget_comparison()

    # beside the loop

    def _record(self, write: Callable, *details: Any) -> None:
        """Write soon; where that fails everybody is told, and the training goes on."""

        async def keep() -> None:
            try:
                await self._written(write, *details)
            except StoreError as error:
                self._studio.say(str(error))

        if not self._closing:
            self._studio.background(keep())

    async def _written(self, write: Callable[..., Answer], *details: Any) -> Answer:
        return await asyncio.get_running_loop().run_in_executor(self._writer, write, *details)

    async def _ask(self, question: Callable[..., Answer], *details: Any) -> Answer:
        """Put a question about a checkpoint to a process that has the learner's libraries."""
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, self._context)
        try:
            return await asyncio.get_running_loop().run_in_executor(self._pool, question, *details)
        except PolicyError as error:
            raise StudioError(_without(self._studio.store.workspace, str(error))) from None
        except OSError as error:
            raise StoreError(f"the checkpoint could not be copied: {error.strerror or error}") from None
        except BrokenProcessPool:
            self._pool = None
            raise StudioError("trying the checkpoint broke off; ask again", 409) from None


def _without(folder: Path, words: str) -> str:
    """A message with places inside the workspace named from there on."""
    return words.replace(f"{folder}/", "")
