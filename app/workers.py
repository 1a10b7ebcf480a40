"""Watches over the mission process: a dead or silent one is replaced and given its last snapshot.

pybullet holds the interpreter lock and may crash; in a process of its own neither touches the server.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from multiprocessing import connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from app.mission_process import Call, Edit, Load, Play, Progress, Refused, Saved, Speed, Step, child_main
from planner.frames import Perception
from planner.mission import MissionSnapshot
from scenes.scenario import Scenario

SILENCE_LIMIT_S = 8.0
LOADING_LIMIT_S = 180.0
RESTARTS_BEFORE_GIVING_UP = 3
CALM_AFTER_S = 60.0  # a process that has lived this long was not broken from the start


@dataclass
class _Listeners:
    progress: Callable[[Progress, bool], None]  # the report; whether it answers every order sent
    refused: Callable[[str], None]
    died: Callable[[str, bool], None]  # what happened; whether it is being restored


@dataclass
class _Running:
    """A child, and the orders on their way to it: whoever gives one does not wait until it can be taken."""

    process: Any
    pipe: connection.Connection
    sent: int = 0
    since: float = field(default_factory=time.monotonic)
    patience_s: float = LOADING_LIMIT_S
    lock: threading.Lock = field(default_factory=threading.Lock)
    outbox: SimpleQueue = field(default_factory=SimpleQueue)

    def __post_init__(self) -> None:
        threading.Thread(target=self._post, name="mission-orders", daemon=True).start()

    def _post(self) -> None:
        # once the child is gone, the watching thread sees it and restores what was loaded
        with contextlib.suppress(OSError, ValueError):
            while (order := self.outbox.get()) is not None:
                self.pipe.send(order)


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
        self._deaths = 0
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
            running.outbox.put(None)
            running.process.terminate()
            running.process.join(1.0)
            if running.process.is_alive():
                running.process.kill()
                running.process.join(1.0)
        if self._thread.is_alive():
            self._thread.join(2.0)

    def load(
        self,
        scenario: Scenario,
        method: str,
        seed: int,
        perception: Perception,
        playing: bool = False,
        weights: Path | None = None,
    ) -> int:
        """Begin a mission anew; returns the generation that its reports will carry."""
        with self._guard:
            self._generation += 1
            self._snapshot = None
            self._deaths = 0
            self._loaded = Load(
                self._generation, scenario, method, seed, perception, None, playing, weights
            )
            if self._running is None:
                self._spawn()
            else:
                self._send(self._loaded)
            return self._generation

    def edit(self, scenario: Scenario, fields: tuple[str, ...], goal_set: bool = False) -> None:
        """Hand on edited fields of a scenario whose terrain is the loaded one's."""
        with self._guard:
            if self._loaded is not None:
                self._loaded = replace(self._loaded, scenario=scenario)
            self._send(Edit({name: getattr(scenario, name) for name in fields}, goal_set))

    def set_method(self, name: str, weights: Path | None = None) -> None:
        """Plan with another method, or with weights of a training."""
        self._set("set_method", method=name, weights=weights)

    def set_perception(self, mode: Perception) -> None:
        self._set("set_perception", perception=mode)

    def _set(self, setter: str, **values: Any) -> None:
        with self._guard:
            if self._loaded is not None:
                self._loaded = replace(self._loaded, **values)
            self._send(Call(setter, tuple(values.values())))

    def set_pose(self, x: float, y: float, yaw: float) -> None:
        """Put the robot somewhere; yaw in radians."""
        self._send(Call("set_pose", (x, y, yaw)))

    def stop(self) -> None:
        self._send(Call("stop", ()))

    def play(self, playing: bool) -> None:
        with self._guard:
            if self._running is None and self._loaded is not None:
                self._deaths = 0
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
                target=child_main, args=(theirs, ours), name="covernav-mission", daemon=True
            )
            process.start()
            theirs.close()
            self._running = _Running(process, ours)
            self._send(Speed(self._factor))
            if self._loaded is not None:
                resume = self._snapshot is not None
                playing = self._loaded.playing and not resume
                self._send(replace(self._loaded, snapshot=self._snapshot, playing=playing))

    def _send(self, order: Any) -> None:
        running = self._running
        if running is None:
            return
        with running.lock:
            if _is_slow(order):
                running.patience_s = LOADING_LIMIT_S
            running.sent += 1
            running.outbox.put(order)

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
            current = report.obeyed >= running.sent
            if current:
                running.patience_s = SILENCE_LIMIT_S
            self._listeners.progress(report, current)

    def _bury(self, running: _Running, silent: bool) -> None:
        running.outbox.put(None)
        running.pipe.close()
        with self._guard:
            calm = time.monotonic() - running.since > CALM_AFTER_S
            self._deaths = 1 if calm else self._deaths + 1
            restore = self._deaths < RESTARTS_BEFORE_GIVING_UP
            self._running = None
            reason = "stopped answering" if silent else how_it_ended(running.process.exitcode)
            self._listeners.died(reason, restore)
            if restore and not self._closing:
                self._spawn()


def _is_slow(order: Any) -> bool:
    """Whether an order may take longer than a child may be silent."""
    match order:
        case Load() | Call(setter="set_method"):
            return True  # a learned one's libraries take their time
        case Edit(changes):
            return "cover" in changes
    return False


def how_it_ended(exitcode: int | None) -> str:
    """A process's end in words, after its name."""
    if exitcode is not None and exitcode < 0:
        try:
            return f"was ended by {signal.Signals(-exitcode).name}"
        except ValueError:
            return f"was ended by signal {-exitcode}"
    return f"ended with exit status {exitcode}" if exitcode is not None else "ended"
