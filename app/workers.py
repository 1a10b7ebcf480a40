"""The mission in a process of its own, watched over by the server.

pybullet holds the interpreter lock and may crash; here neither touches the server. The parent sends small
orders down a pipe; the child sends back reports: frames (the newest wins), now and then a snapshot to go on
from, and refusals. A dead or silent child is replaced and given the last snapshot.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing import connection
from typing import Any

from planner.frames import Frame, Perception, Status
from planner.mission import Mission, MissionSnapshot
from scenes.scenario import Scenario

FRAME_PERIOD_S = 1.0 / 15.0  # what the view can use
SNAPSHOT_PERIOD_S = 0.5
SILENCE_LIMIT_S = 8.0
LOADING_LIMIT_S = 180.0
RESTARTS_BEFORE_GIVING_UP = 3
CALM_AFTER_S = 20.0


# orders, parent to child


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


# reports, child to parent


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

    def __init__(self, pipe: connection.Connection) -> None:
        self.pipe = pipe
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
            if self.pipe.poll(wait):
                self.obey(self.pipe.recv())
            elif busy:
                self.tick()
            else:
                self.report()

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
                    getattr(self.mission, setter)(*arguments)
        except ValueError as error:
            self.pipe.send(Refused(str(error)))
        self.obeyed += 1
        self.report()

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
        self.mission = Mission(
            order.scenario, order.method, order.seed, order.perception, snapshot=order.snapshot
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
        if now - self.saved >= SNAPSHOT_PERIOD_S and not mission.status.final:
            self.saved = now
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
    pose, twist = frame.pose, frame.twist
    return (frame.time_s, pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw, twist.v, twist.w)


def _child_main(pipe: connection.Connection, parent_end: connection.Connection) -> None:
    parent_end.close()  # else this end would keep the pipe open after the server has gone
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the server has gone
        _Child(pipe).run()


@dataclass
class _Listeners:
    progress: Callable[[Progress, bool], None]  # the report; whether it answers every order sent
    refused: Callable[[str], None]
    died: Callable[[str, bool], None]  # what happened; whether it is being restored


@dataclass
class _Running:
    process: Any
    pipe: connection.Connection
    sent: int = 0
    patience_s: float = LOADING_LIMIT_S
    lock: threading.Lock = field(default_factory=threading.Lock)


class MissionWorker:
    """The parent's side. Listeners are called on the watching thread.

    on_progress(Progress, whether it answers every order sent), on_refused(reason),
    on_died(what happened, whether it is being restored)
    """

    def __init__(
        self,
        on_progress: Callable[[Progress, bool], None],
        on_refused: Callable[[str], None],
        on_died: Callable[[str, bool], None],
    ) -> None:
        self._listeners = _Listeners(on_progress, on_refused, on_died)
        self._context = multiprocessing.get_context("spawn")
        self._guard = threading.RLock()
        self._generation = 0
        self._loaded: Load | None = None
        self._snapshot: MissionSnapshot | None = None
        self._factor = 1.0
        self._deaths: list[float] = []
        self._closing = False
        self._running: _Running | None = None
        self._thread = threading.Thread(target=self._watch, name="mission-watch", daemon=True)

    @property
    def pid(self) -> int | None:
        return self._running.process.pid if self._running else None

    def start(self) -> None:
        """Watch over the child that the first `load` starts."""
        self._thread.start()

    def close(self) -> None:
        """End the child; returns within about two seconds."""
        self._closing = True
        with self._guard:
            running = self._running
        if running is not None:
            running.process.terminate()
            running.process.join(1.0)
            if running.process.is_alive():
                running.process.kill()
                running.process.join(1.0)
        if self._thread.is_alive():
            self._thread.join(2.0)

    def load(
        self, scenario: Scenario, method: str, seed: int, perception: Perception, playing: bool = False
    ) -> int:
        """Begin a mission anew; returns the generation that its reports will carry."""
        with self._guard:
            self._generation += 1
            self._snapshot = None
            self._deaths.clear()
            self._loaded = Load(self._generation, scenario, method, seed, perception, None, playing)
            if self._running is None:
                self._spawn()
            else:
                self._send(self._loaded)
            return self._generation

    def edit(self, scenario: Scenario, fields: tuple[str, ...], goal_set: bool = False) -> None:
        """Hand on edited fields of a scenario whose terrain is the loaded one's."""
        with self._guard:
            if self._loaded is not None:
                self._loaded = _replaced(self._loaded, scenario=scenario)
            self._send(Edit({name: getattr(scenario, name) for name in fields}, goal_set))

    def set_method(self, name: str) -> None:
        self._set("method", name, "set_method")

    def set_perception(self, mode: Perception) -> None:
        self._set("perception", mode, "set_perception")

    def _set(self, field_name: str, value: Any, setter: str) -> None:
        with self._guard:
            if self._loaded is not None:
                self._loaded = _replaced(self._loaded, **{field_name: value})
            self._send(Call(setter, (value,)))

    def set_pose(self, x: float, y: float, yaw: float) -> None:
        """Put the robot somewhere; yaw in radians."""
        self._send(Call("set_pose", (x, y, yaw)))

    def stop(self) -> None:
        self._send(Call("stop", ()))

    def play(self, playing: bool) -> None:
        with self._guard:
            if self._running is None and self._loaded is not None:
                self._deaths.clear()
                self._spawn()
            self._send(Play(playing))

    def step(self) -> None:
        self._send(Step())

    def set_speed(self, factor: float) -> None:
        self._factor = factor
        self._send(Speed(factor))

    # supervision

    def _spawn(self) -> None:
        with self._guard:
            ours, theirs = self._context.Pipe()
            process = self._context.Process(
                target=_child_main, args=(theirs, ours), name="covernav-mission", daemon=True
            )
            process.start()
            theirs.close()
            self._running = _Running(process, ours)
            self._send(Speed(self._factor))
            if self._loaded is not None:
                resume = self._snapshot is not None
                playing = self._loaded.playing and not resume
                self._send(_replaced(self._loaded, snapshot=self._snapshot, playing=playing))

    def _send(self, order: Any) -> None:
        running = self._running
        if running is None:
            return
        try:
            with running.lock:
                if isinstance(order, Load):
                    running.patience_s = LOADING_LIMIT_S
                running.sent += 1
                running.pipe.send(order)
        except (OSError, ValueError):
            pass  # the child is gone: the watching thread sees it and restores what was loaded

    def _watch(self) -> None:
        heard = time.monotonic()
        current: _Running | None = None
        while not self._closing:
            running = self._running
            if running is None:
                time.sleep(0.05)
                continue
            if running is not current:
                current, heard = running, time.monotonic()
            ready = connection.wait([running.pipe, running.process.sentinel], timeout=0.25)
            if running.pipe in ready:
                try:
                    self._hear(running, running.pipe.recv())
                    heard = time.monotonic()
                    continue
                except (EOFError, OSError):
                    running.process.join(0.5)
            if self._closing:
                return
            silent = time.monotonic() - heard > running.patience_s
            if silent:
                running.process.kill()
                running.process.join(1.0)
            if silent or not running.process.is_alive():
                self._bury(running, silent)

    def _hear(self, running: _Running, report: Any) -> None:
        if isinstance(report, Saved):
            with self._guard:
                if report.generation == self._generation:
                    self._snapshot = report.snapshot
        elif isinstance(report, Refused):
            self._listeners.refused(report.reason)
        elif report.generation == self._generation:
            running.patience_s = SILENCE_LIMIT_S
            self._listeners.progress(report, report.obeyed >= running.sent)

    def _bury(self, running: _Running, silent: bool) -> None:
        running.pipe.close()
        now = time.monotonic()
        with self._guard:
            self._deaths = [then for then in self._deaths if now - then < CALM_AFTER_S] + [now]
            restore = len(self._deaths) < RESTARTS_BEFORE_GIVING_UP
            self._running = None
            reason = "stopped answering" if silent else _how_it_ended(running.process.exitcode)
            self._listeners.died(reason, restore)
            if restore and not self._closing:
                self._spawn()


def _replaced(load: Load, **changes: Any) -> Load:
    return Load(**{**load.__dict__, **changes})


def _how_it_ended(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        try:
            return f"was ended by {signal.Signals(-exitcode).name}"
        except ValueError:
            return f"was ended by signal {-exitcode}"
    return f"ended with exit status {exitcode}" if exitcode is not None else "ended"
