"""An evaluation under way: missions to processes, results to the journal, whatever happens to either.

On this machine joblib distributes over loky's processes; one job is this process. What a worker was driving
when it was killed is driven again, alone, and at last counted as an error. `planner.evaluation_cluster`
drives elsewhere.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from typing import Any, Protocol, cast

from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from planner import evaluation
from planner.evaluation import MissionSpec, failed
from planner.evaluation_journal import Journal
from scenes.embree import use_threads

ATTEMPTS = 2
"""How often a mission may take its worker with it, alone, before that is its result."""

Result = dict[str, Any]


class Pool(Protocol):
    """Where missions are driven."""

    def driven(self, missing: Sequence[MissionSpec], stop: threading.Event) -> Iterator[Result]:
        """Each mission's result as it is finished; none is begun once `stop` is set."""
        ...


def evaluate(
    wanted: Sequence[MissionSpec],
    pool: Pool,
    journal: Journal | None = None,
    stop: threading.Event | None = None,
) -> Iterator[Result]:
    """Yield every mission's result: first those that the journal holds, then each as it is finished.

    stop : when set, missions under way are finished and no more begun; so it is when the disk is full
    Raises OSError where the journal cannot be written.
    """
    stop = stop or threading.Event()
    done = journal.results if journal is not None else {}
    kept = [done[spec] for spec in wanted if spec in done]
    missing = [spec for spec in wanted if spec not in done]
    yield from kept
    if not missing:
        return
    for result in pool.driven(missing, stop):
        if journal is not None:
            journal.add(result)
            if journal.full:
                stop.set()
        yield result


class Local:
    """`jobs` processes on this machine, or this one; `attempt` drives a mission whatever goes wrong in it."""

    def __init__(self, jobs: int, attempt: Callable[[MissionSpec], Result] | None = None) -> None:
        self._jobs = jobs
        threads = max(1, len(os.sched_getaffinity(0)) // jobs)
        self._attempt = attempt or (attempt_here if jobs == 1 else partial(attempt_apart, threads=threads))

    def driven(self, missing: Sequence[MissionSpec], stop: threading.Event) -> Iterator[Result]:
        """See `Pool`; its processes end with it."""
        suspects: set[MissionSpec] = set()
        crashes: Counter[MissionSpec] = Counter()
        queue, at_once = deque(missing), True
        try:
            while queue and not stop.is_set():
                # what was under way when a worker died drives alone, to know which is to blame the next time
                turn = [spec for spec in queue if spec not in suspects] or [queue[0]]
                flying: dict[MissionSpec, None] = {}
                finished: set[MissionSpec] = set()
                try:
                    for spec, result in self._turn(turn, stop, flying):
                        finished.add(spec)
                        yield result
                except BrokenProcessPool:
                    suspects |= flying.keys() - finished
                    crashes.update(list(flying) if len(turn) == 1 else [])
                for spec in [spec for spec in queue if crashes[spec] >= ATTEMPTS]:
                    finished.add(spec)
                    yield failed(spec, f"its process was killed {ATTEMPTS} times while it drove that alone")
                queue = deque(spec for spec in queue if spec not in finished)
            at_once = False
        finally:
            if self._jobs > 1:
                get_reusable_executor().shutdown(wait=True, kill_workers=at_once)

    def _turn(
        self, turn: list[MissionSpec], stop: threading.Event, flying: dict[MissionSpec, None]
    ) -> Iterator[tuple[MissionSpec, Result]]:
        """Drive some missions; `flying` takes up those that were begun."""

        def begun() -> Iterator[Any]:
            for spec in turn:
                if stop.is_set():
                    return
                flying[spec] = None
                yield delayed(_with_spec)(self._attempt, spec)

        options: Any = {"pre_dispatch": self._jobs, "batch_size": 1}
        parallel = Parallel(n_jobs=self._jobs, return_as="generator_unordered", **options)
        yield from cast(Iterator[tuple[MissionSpec, Result]], parallel(begun()))


def _with_spec(attempt: Callable[[MissionSpec], Result], spec: MissionSpec) -> tuple[MissionSpec, Result]:
    return spec, attempt(spec)


def attempt_here(spec: MissionSpec) -> Result:
    """Drive a mission; what goes wrong in it is its result."""
    try:
        return evaluation.drive(spec)
    except Exception as error:
        return failed(spec, " ".join(f"{type(error).__name__}: {error}".split()))


def attempt_apart(spec: MissionSpec, threads: int = 1) -> Result:
    """As `attempt_here`, in a process that leaves Ctrl-C to its parent and ends with it.

    threads : for rays"""
    _settle(threads)
    return attempt_here(spec)


@cache
def _settle(threads: int) -> None:
    use_threads(threads)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
