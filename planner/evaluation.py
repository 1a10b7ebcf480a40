"""Methods × terrains × seeds to a table: the same missions for every method, so that rows can be compared."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from joblib import Parallel, delayed

from planner.frames import Perception, Status
from planner.mission import Mission
from planner.warm_up import warm_up
from scenes.families import generate
from scenes.scenario import Family


@dataclass(frozen=True, order=True)
class MissionSpec:
    """One drive: the generated scene of `seed` in `terrain`, driven by `method`."""

    terrain: Family
    method: str
    seed: int
    perception: Perception
    goal_distance: float


def size_for(goal_distance: float) -> float:
    """Side of the square map in metres: room for the drive and a detour around it."""
    return max(48.0, 1.6 * goal_distance)


def drive(spec: MissionSpec) -> dict[str, Any]:
    """Drive one mission in full physics; the summary as `run --json` and what it was."""
    warm_up()
    scenario = generate(
        spec.terrain, spec.seed, size_m=size_for(spec.goal_distance), goal_distance=spec.goal_distance
    )
    mission = Mission(scenario, spec.method, spec.seed, spec.perception)
    try:
        for _ in mission.frames():
            pass
        return asdict(spec) | mission.summary()
    finally:
        mission.close()


def specs(
    methods: Sequence[str],
    terrains: Sequence[Family],
    missions: int,
    seed: int,
    perception: Perception,
    goal_distance: float,
) -> list[MissionSpec]:
    """Every mission of an evaluation; mission i has seed + i whatever the method."""
    return [
        MissionSpec(terrain, method, seed + index, perception, goal_distance)
        for terrain in terrains
        for method in methods
        for index in range(missions)
    ]


def evaluate(
    wanted: Sequence[MissionSpec], jobs: int, journal: Path | None = None
) -> Iterator[dict[str, Any]]:
    """Drive the missions on `jobs` processes and yield each as it is finished.

    With a journal (JSON lines) finished missions are kept there, and those it holds are not driven again.
    Raises OSError where the journal cannot be written, ValueError where it is damaged.
    """
    done = dict(_read(journal)) if journal is not None else {}
    missing = [spec for spec in wanted if spec not in done]
    yield from (done[spec] for spec in wanted if spec in done)
    parallel = Parallel(n_jobs=jobs, return_as="generator_unordered")
    for result in cast(Iterator[dict[str, Any]], parallel(delayed(drive)(spec) for spec in missing)):
        if journal is not None:
            with journal.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(result) + "\n")
        yield result


def _read(journal: Path) -> Iterator[tuple[MissionSpec, dict[str, Any]]]:
    if not journal.exists():
        return
    text = journal.read_text("utf-8")
    if text and not text.endswith("\n"):  # cut off in the middle of a line: that mission is driven again
        text = text[: text.rfind("\n") + 1]
        journal.write_text(text, "utf-8")
    for number, line in enumerate(text.splitlines(), 1):
        try:
            result = json.loads(line)
            spec = MissionSpec(
                Family(result["terrain"]),
                result["method"],
                result["seed"],
                Perception(result["perception"]),
                result["goal_distance"],
            )
        except (ValueError, KeyError, TypeError):
            problem = f"{journal}, line {number}: not a finished mission; move the file away"
            raise ValueError(problem) from None
        yield spec, result


def wilson(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """95 % score interval of a rate (Wilson 1927)."""
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    scale = 1.0 + z * z / trials
    middle = (rate + z * z / (2.0 * trials)) / scale
    half = z / scale * math.sqrt(rate * (1.0 - rate) / trials + z * z / (4.0 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def tabulate(missions: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row a terrain, method and perception; lengths and times are means over the successes."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for mission in missions:
        key = (mission["terrain"], mission["method"], mission["perception"])
        groups.setdefault(key, []).append(mission)
    order = [family.value for family in Family]
    keys = sorted(groups, key=lambda key: (order.index(key[0]), *key[1:]))
    return [_row(*key, sorted(groups[key], key=lambda mission: mission["seed"])) for key in keys]


def _row(terrain: str, method: str, perception: str, missions: list[dict[str, Any]]) -> dict[str, Any]:
    good = [mission for mission in missions if mission["success"]]
    statuses = Counter(mission["status"] for mission in missions)
    count = len(missions)
    return {
        "terrain": terrain,
        "method": method,
        "suite": "random",
        "perception": perception,
        "missions": count,
        "successes": len(good),
        "success_rate": len(good) / count,
        "success_ci95": list(wilson(len(good), count)),
        "trajectory_length_m": _mean(mission["trajectory_length_m"] for mission in good),
        "length_ratio": _mean(
            mission["trajectory_length_m"] / mission["straight_line_m"] for mission in good
        ),
        "execution_time_s": _mean(mission["execution_time_s"] for mission in good),
        "cover_fraction": _mean(mission["cover_fraction"] for mission in good),
        "collision_rate": statuses[Status.COLLIDED] / count,
        "timeout_rate": statuses[Status.TIMEOUT] / count,
        "failures": {status: n for status, n in sorted(statuses.items()) if status != Status.REACHED},
        "planner_ms_p50": _mean(mission["planner_ms_p50"] for mission in missions),
    }


def _mean(values: Iterable[float]) -> float | None:
    numbers = list(values)
    return float(np.mean(numbers)) if numbers else None
