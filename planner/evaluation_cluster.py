"""Missions driven on a Ray cluster: the same specs, the same results, on whatever nodes there are.

Ray's own tasks, not its joblib backend: that one neither streams results nor outlives the loss of a node. A
task whose node or process is lost runs again elsewhere, `RETRIES` times.
"""

from __future__ import annotations

import importlib
import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from planner.evaluation import MissionSpec, failed
from planner.evaluation_run import Result, attempt_here
from scenes.embree import use_threads

RETRIES = 4
LOOK_S = 1.0


class ClusterError(ValueError):
    """A cluster that cannot be used, in one sentence."""


def _attempted(attempt: Callable[[MissionSpec], Result], spec: MissionSpec) -> Result:
    use_threads(1)  # a task has one CPU
    return attempt(spec)


class Cluster:
    """Every CPU of the cluster at `address`, `HOST:PORT` of its head node, or `auto` for the one that runs
    here. This project must be installed on its nodes in the same version.

    Raises ClusterError where Ray is not installed or nobody answers.
    """

    def __init__(self, address: str, attempt: Callable[[MissionSpec], Result] = attempt_here) -> None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is told to anybody
        try:
            self._ray: Any = importlib.import_module("ray")
            if not hasattr(self._ray, "init"):  # a folder that happens to have the name
                raise ImportError
        except ImportError:
            raise ClusterError(
                "--cluster needs Ray, which is not installed;"
                " install the studio with its extra, pip install '.[cluster]'"
            ) from None
        try:
            self._ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
        except Exception as error:  # Ray has no one class for it
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise ClusterError(
                f"no Ray cluster can be used at {address}: {reason}; `ray start --head` begins one"
            ) from None
        self._attempt = attempt

    def driven(self, missing: Sequence[MissionSpec], stop: threading.Event) -> Iterator[Result]:
        """See `planner.evaluation_run.Pool`; leaves the cluster when it is over."""
        ray = self._ray
        task = ray.remote(num_cpus=1, max_retries=RETRIES, scheduling_strategy="SPREAD")(_attempted)
        queue: deque[MissionSpec] = deque(missing)
        flying: dict[Any, MissionSpec] = {}
        try:
            while flying or (queue and not stop.is_set()):
                while queue and not stop.is_set() and len(flying) < self._places():
                    spec = queue.popleft()
                    flying[task.remote(self._attempt, spec)] = spec
                ready, _ = ray.wait(list(flying), timeout=LOOK_S)
                for reference in ready:
                    yield self._result(reference, flying.pop(reference))
        finally:
            for reference in flying:
                ray.cancel(reference, force=True)
            ray.shutdown()

    def _places(self) -> int:
        """How many missions may be under way: nodes come and go."""
        return max(int(self._ray.cluster_resources().get("CPU", 1)), 1)

    def _result(self, reference: Any, spec: MissionSpec) -> Result:
        try:
            return self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            reason = " ".join(str(error).split())[:300]
            return failed(spec, f"the cluster lost it {RETRIES + 1} times or could not begin it: {reason}")
