"""An evaluation under way: missions to processes, results to the journal, whatever happens to either.

On this machine joblib's processes (loky) drive; one job is this process. What a worker was driving when it
was killed is driven again, and at last counted as an error. `planner.evaluation_cluster` drives elsewhere.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from planner import evaluation
from planner.evaluation import MissionSpec, failed
from planner.evaluation_journal import Journal
from planner.frames import Perception
from planner.warm_up import warm_up
from scenes.embree import use_threads

ATTEMPTS = 2
"""How often a mission may take its worker with it before that is its result."""

THREADS_OF_LIBRARIES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS",
)  # fmt: skip

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
        self._jobs, self._attempt = jobs, attempt or attempt_here

    def driven(self, missing: Sequence[MissionSpec], stop: threading.Event) -> Iterator[Result]:
        """See `Pool`; its processes end with it."""
        if self._jobs > 1:
            yield from self._apart(missing, stop)
            return
        for spec in missing:
            if stop.is_set():
                return
            yield self._attempt(spec)

    def _apart(self, missing: Sequence[MissionSpec], stop: threading.Event) -> Iterator[Result]:
        plan, at_once = Plan(missing), True
        threads = max(1, len(os.sched_getaffinity(0)) // self._jobs)
        known = missing if self._attempt is attempt_here else ()
        methods = tuple(dict.fromkeys((spec.method, spec.perception) for spec in known))
        workers = [Worker(threads, methods) for _ in range(min(self._jobs, len(missing)))]
        flying: dict[Future[Result], tuple[Worker, MissionSpec]] = {}

        def begin(worker: Worker) -> None:
            spec = None if stop.is_set() else plan.next_for(worker)
            if spec is not None:
                flying[worker.begin(self._attempt, spec)] = worker, spec

        crashes: Counter[MissionSpec] = Counter()
        try:
            for worker in workers:
                begin(worker)
            while flying:
                ready, _ = wait(flying, return_when=FIRST_COMPLETED)
                for future in ready:
                    worker, spec = flying.pop(future)
                    result = None
                    try:
                        result = future.result()
                    except BrokenProcessPool:
                        worker.renew()
                        crashes[spec] += 1
                        if crashes[spec] < ATTEMPTS:
                            plan.put_back(worker, spec)
                        else:
                            result = failed(spec, f"its process was killed {ATTEMPTS} times in that mission")
                    begin(worker)
                    if result is not None:
                        yield result
            at_once = False
        finally:
            for worker in workers:
                worker.end(at_once)


class Worker:
    """One process of joblib's, which drives one mission at a time: who dies is who was to blame.

    threads : that rays and each of its libraries may use
    methods : those that it will drive, with their perceptions
    """

    def __init__(self, threads: int, methods: tuple[tuple[str, Perception], ...]) -> None:
        self._limits = {name: os.environ.get(name, str(threads)) for name in THREADS_OF_LIBRARIES}
        self._settle = partial(_settle, threads, methods)
        self._executor = self._new()

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(max_workers=1, env=self._limits, initializer=self._settle)

    def begin(self, attempt: Callable[[MissionSpec], Result], spec: MissionSpec) -> Future[Result]:
        try:
            return self._executor.submit(attempt, spec)
        except BrokenProcessPool:  # it died while it had nothing to do
            self.renew()
            return self._executor.submit(attempt, spec)

    def renew(self) -> None:
        """Put a new process in the place of one that died."""
        self.end(at_once=True)
        self._executor = self._new()

    def end(self, at_once: bool) -> None:
        self._executor.shutdown(wait=True, kill_workers=at_once)


class Plan:
    """What is left to drive. Whoever has driven a mission with one method gets its other methods, too, for
    it has made the scene; at last the others' are shared."""

    def __init__(self, wanted: Sequence[MissionSpec]) -> None:
        by_mission: dict[MissionSpec, deque[MissionSpec]] = defaultdict(deque)
        for spec in wanted:
            by_mission[replace(spec, method="")].append(spec)
        self._untouched = deque(by_mission.values())
        self._held: dict[Hashable, deque[MissionSpec]] = {}

    def next_for(self, worker: Hashable) -> MissionSpec | None:
        """None when nothing is left."""
        if not self._held.get(worker):
            if self._untouched:
                self._held[worker] = self._untouched.popleft()
            else:
                most = max(self._held.values(), key=len, default=deque())
                return most.pop() if most else None
        return self._held[worker].popleft()

    def put_back(self, worker: Hashable, spec: MissionSpec) -> None:
        """For another attempt."""
        self._held.setdefault(worker, deque()).appendleft(spec)


def attempt_here(spec: MissionSpec) -> Result:
    """Drive a mission; what goes wrong in it is its result."""
    try:
        return evaluation.drive(spec)
    except Exception as error:
        return failed(spec, " ".join(f"{type(error).__name__}: {error}".split()))


def _settle(threads: int, methods: tuple[tuple[str, Perception], ...]) -> None:
    """Be a process that leaves Ctrl-C to its parent, ends with it, and has all that it needs from the start:
    joblib takes what a process comes to need later for a leak, and looks for garbage after every drive."""
    use_threads(threads)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    for method, perception in methods:
        with contextlib.suppress(Exception):  # its drives meet it again and tell
            warm_up(method, perception)
    gc.collect()
    gc.freeze()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
