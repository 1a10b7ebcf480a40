"""The mission process: the loop that drives, and what it and the server say to each other.

The server sends small orders down a pipe; this side sends back reports: frames (the newest wins), now and
then a snapshot to go on from, and refusals.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from planner.frames import Frame, Perception, Status
from planner.mission import Mission, MissionSnapshot
from planner.warm_up import warm_up
from scenes.scenario import Scenario

FRAME_PERIOD_S = 1.0 / 15.0  # what the view can use
SNAPSHOT_PERIOD_S = 0.5


@dataclass(frozen=True)
class Load:
    """Begin a mission, from its start or from a snapshot."""

    generation: int
    scenario: Scenario
    method: str
    seed: int
    perception: Perception
    snapshot: MissionSnapshot | None = None
    playing: bool = False
    weights: Path | None = None  # of a training, for the learned method


@dataclass(frozen=True)
class Edit:
    """Fields of the scenario but its terrain, to take effect at once; `goal_set` starts a new leg."""

    changes: dict[str, Any]
    goal_set: bool = False


@dataclass(frozen=True)
class Call:
    """Call one of the mission's setters."""

    setter: str
    arguments: tuple


@dataclass(frozen=True)
class Play:
    playing: bool


@dataclass(frozen=True)
class Step:
    pass


@dataclass(frozen=True)
class Speed:
    factor: float


@dataclass(frozen=True)
class Progress:
    """Where the mission stands; `rows` are the numbers of every tick since the last report.

    obeyed : how many orders the child has carried out; fewer than were sent means the status is old
    """

    generation: int
    obeyed: int
    status: Status
    frame: Frame | None
    rows: tuple[tuple[float, ...], ...]
    real_factor: float
    summary: dict[str, Any] | None  # as `covernav run --json`, once the robot has moved


@dataclass(frozen=True)
class Saved:
    generation: int
    snapshot: MissionSnapshot


@dataclass(frozen=True)
class Refused:
    """An order that could not be carried out, in one sentence."""

    reason: str


class _Child:
    """The loop inside the worker process."""

    def __init__(self, pipe: connection.Connection, orders: SimpleQueue) -> None:
        self.pipe, self.orders = pipe, orders
        self.mission: Mission | None = None
        self.generation = self.obeyed = 0
        self.playing = False
        self.factor = 1.0
        self.due = time.perf_counter()
        self.sent = self.saved = 0.0
        self.rows: list[tuple[float, ...]] = []
        self.pace = _Pace()

    def run(self) -> None:
        while True:
            busy = self.playing and self.mission is not None and not self.mission.status.final
            wait = max(0.0, self.due - time.perf_counter()) if busy else 1.0
            try:
                order = self.orders.get(timeout=wait) if wait > 0.0 else self.orders.get_nowait()
            except Empty:
                (self.tick if busy else self.report)()
                continue
            if order is None:
                return  # the server has gone
            self.obey(order)

    def obey(self, order: Any) -> None:
        try:
            match order:
                case Load():
                    self.load(order)
                case Play(playing):
                    self.playing, self.due = playing, time.perf_counter()
                    self.pace.restart()
                case Step():
                    self.playing = False
                    self.tick()
                case Speed(factor):
                    self.factor, self.due = factor, time.perf_counter()
                    self.pace.restart()
                case Edit() if self.mission is not None:
                    self.edit(self.mission, order)
                case Call(setter, arguments) if self.mission is not None:
                    self.call(self.mission, setter, arguments)
        except ValueError as error:
            self.pipe.send(Refused(str(error)))
        self.obeyed += 1
        self.report()

    def call(self, mission: Mission, setter: str, arguments: tuple) -> None:
        """A robot that was stopped, or is put somewhere after its drive, waits for `Play`."""
        waits = setter == "stop" or (setter == "set_pose" and mission.status.final)
        _warm_up_for(mission, setter, arguments)
        getattr(mission, setter)(*arguments)
        if waits:
            self.playing = False
        if setter in ("stop", "set_pose"):
            self.save(mission)

    def edit(self, mission: Mission, order: Edit) -> None:
        mission.edit(mission.scenario.model_copy(update=order.changes))
        if order.goal_set:
            goal = mission.scenario.goal
            mission.set_goal(goal.x, goal.y)
            self.due = time.perf_counter()

    def load(self, order: Load) -> None:
        if self.mission is not None:
            self.mission.close()
            self.mission = None
        self.generation, self.rows = order.generation, []
        warm_up(order.method, order.perception, order.weights)
        self.mission = Mission(
            order.scenario,
            order.method,
            order.seed,
            order.perception,
            snapshot=order.snapshot,
            weights=order.weights,
        )
        self.playing, self.due = order.playing, time.perf_counter()
        self.pace.restart()

    def tick(self) -> None:
        mission = self.mission
        if mission is None or mission.status.final:
            return
        frame = mission.tick()
        self.rows.append(frame_row(frame))
        now = time.perf_counter()
        period = mission.tick_s / self.factor
        self.due = max(self.due + period, now - period)
        self.pace.count(mission.tick_s)
        if mission.status.final or now - self.sent >= FRAME_PERIOD_S or not self.playing:
            self.report()
        if now - self.saved >= SNAPSHOT_PERIOD_S or mission.status.final:
            self.save(mission)

    def save(self, mission: Mission) -> None:
        """Give the server what it restores should this process die."""
        self.saved = time.perf_counter()
        self.pipe.send(Saved(self.generation, mission.snapshot()))

    def report(self) -> None:
        self.sent = time.perf_counter()
        mission = self.mission
        frame = mission.frame if mission is not None else None
        rows, self.rows = tuple(self.rows), []
        started = frame is not None and frame.tick > 0
        summary = mission.summary() if mission is not None and started else None
        if mission is None:
            status = Status.IDLE
        elif mission.status.final:
            status = mission.status
        elif self.playing:
            status = Status.RUNNING
        else:
            status = Status.PAUSED if started else Status.IDLE
        factor = self.pace.factor if status is Status.RUNNING else 0.0
        self.pipe.send(Progress(self.generation, self.obeyed, status, frame, rows, factor, summary))


def _warm_up_for(mission: Mission, setter: str, arguments: tuple) -> None:
    """Make what another method or perception needs before the next tick, not in it."""
    match setter, *arguments:
        case "set_method", name, weights:
            warm_up(name, mission.perception, weights)
        case "set_perception", perception:
            warm_up(mission.method_name, perception)


class _Pace:
    """How fast simulated time really passes, over about the last second."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self.since, self.simulated, self.factor = time.perf_counter(), 0.0, 0.0

    def count(self, seconds: float) -> None:
        self.simulated += seconds
        elapsed = time.perf_counter() - self.since
        if elapsed >= 1.0 or not self.factor:
            self.factor = self.simulated / max(elapsed, 1e-6)
        if elapsed >= 1.0:
            self.since, self.simulated = time.perf_counter(), 0.0


def frame_row(frame: Frame) -> tuple[float, ...]:
    """A tick's numbers in the order of `app.store.FRAME_COLUMNS`."""
    pose, twist, exposure = frame.pose, frame.twist, frame.exposure
    place = (pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw)
    return (frame.time_s, *place, twist.v, twist.w, exposure.fraction, exposure.detection_probability)


def child_main(pipe: connection.Connection, parent_end: connection.Connection) -> None:
    """Obey and drive until the server has gone."""
    parent_end.close()  # else this end would keep the pipe open after the server has gone
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    orders: SimpleQueue = SimpleQueue()
    threading.Thread(target=_take_orders, args=(pipe, orders), daemon=True).start()
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the server has gone
        _Child(pipe, orders).run()


def _take_orders(pipe: connection.Connection, orders: SimpleQueue) -> None:
    """Read what the server sends as it comes: it must not wait while this side compiles or thinks."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            orders.put(pipe.recv())
    orders.put(None)
