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
from planner.suites import Knowledge, Suite, suite_mission
from planner.warm_up import warm_up
from scenes.scenario import Family

GROUPED_BY = {"terrain": "", "method": "", "suite": "random", "observers": "known", "perception": ""}
"""What makes a row of the table, with what missions mean that do not say."""

WORTH_AVOIDING = 0.5


@dataclass(frozen=True, order=True)
class MissionSpec:
    """One drive: the mission of `seed` in `terrain` and `suite`, driven by `method`."""

    terrain: Family
    method: str
    seed: int
    perception: Perception
    goal_distance: float
    suite: Suite = Suite.RANDOM
    observers: Knowledge = Knowledge.KNOWN


def drive(spec: MissionSpec) -> dict[str, Any]:
    """Drive one mission in full physics: the summary as `run --json`, what it was, and under `shortest_...`
    and `bound_...` what the route engine makes of it (`planner.suites.Reference`)."""
    warm_up()
    set_up = suite_mission(spec.suite, spec.terrain, spec.seed, spec.observers, spec.goal_distance)
    mission = Mission(set_up.scenario, spec.method, spec.seed, spec.perception)
    try:
        for _ in mission.frames():
            pass
        # The spec's own word on observers is whether they are known; the summary's is what each of them saw.
        summary = mission.summary()
        watches = {"watches": summary.pop("observers", [])}
        return asdict(spec) | summary | watches | asdict(set_up.reference)
    finally:
        mission.close()


def specs(
    methods: Sequence[str],
    terrains: Sequence[Family],
    missions: int,
    seed: int,
    perception: Perception,
    goal_distance: float,
    suite: Suite = Suite.RANDOM,
    observers: Knowledge = Knowledge.KNOWN,
) -> list[MissionSpec]:
    """Every mission of an evaluation; mission i has seed + i whatever the method. The methods' drives of one
    mission follow each other, for a process keeps the missions it has made."""
    return [
        MissionSpec(terrain, method, seed + index, perception, goal_distance, suite, observers)
        for terrain in terrains
        for index in range(missions)
        for method in methods
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
                Suite(result.get("suite", Suite.RANDOM)),
                Knowledge(result.get("observers", Knowledge.KNOWN)),
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
    """One row a terrain, method, suite and perception; lengths, times and exposure are means over the
    successes."""
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for mission in missions:
        key = tuple(str(mission.get(name, usual)) for name, usual in GROUPED_BY.items())
        groups.setdefault(key, []).append(mission)
    order = [family.value for family in Family]
    keys = sorted(groups, key=lambda key: (order.index(key[0]), *key[1:]))
    return [
        dict(zip(GROUPED_BY, key, strict=True)) | _row(sorted(groups[key], key=lambda m: m["seed"]))
        for key in keys
    ]


def _row(missions: list[dict[str, Any]]) -> dict[str, Any]:
    good = [mission for mission in missions if mission["success"]]
    statuses = Counter(mission["status"] for mission in missions)
    count = len(missions)
    return {
        "missions": count,
        "successes": len(good),
        "success_rate": len(good) / count,
        "success_ci95": list(wilson(len(good), count)),
        "trajectory_length_m": _mean(good, "trajectory_length_m"),
        "length_ratio": _mean_of(m["trajectory_length_m"] / m["straight_line_m"] for m in good),
        "execution_time_s": _mean(good, "execution_time_s"),
        "exposure_fraction": _mean(good, "exposure_fraction"),
        "exposed_s": _mean(good, "exposed_s"),
        "longest_exposure_s": _mean(good, "longest_exposure_s"),
        "detection_probability": _mean(good, "detection_probability"),
        "avoidable_removed": avoidable_removed(good),
        "cover_fraction": _mean(good, "cover_fraction"),
        "concealed_fraction": _mean(good, "concealed_fraction"),
        "collision_rate": statuses[Status.COLLIDED] / count,
        "timeout_rate": statuses[Status.TIMEOUT] / count,
        "failures": {status: n for status, n in sorted(statuses.items()) if status != Status.REACHED},
        "planner_ms_p50": _mean(missions, "planner_ms_p50"),
    }


def avoidable_removed(missions: Iterable[dict[str, Any]]) -> float | None:
    """Share of the avoidable exposed seconds that the drives were spared, all missions' seconds together:
    (shortest route's - driven) / (shortest route's - bound).

    None where hardly anything could be avoided, less than `WORTH_AVOIDING` seconds a mission."""
    count, spared, avoidable = 0, 0.0, 0.0
    for mission in missions:
        if mission.get("bound_s") is not None and mission.get("exposed_s") is not None:
            spared += mission["shortest_s"] - mission["exposed_s"]
            avoidable += mission["shortest_s"] - mission["bound_s"]
            count += 1
    return spared / avoidable if count and avoidable >= WORTH_AVOIDING * count else None


def _mean(missions: Iterable[dict[str, Any]], key: str) -> float | None:
    """Over the missions that have it; those of older journals lack what was not measured then."""
    return _mean_of(mission[key] for mission in missions if mission.get(key) is not None)


def _mean_of(values: Iterable[float]) -> float | None:
    numbers = list(values)
    return float(np.mean(numbers)) if numbers else None
