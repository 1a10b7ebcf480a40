"""The table of an evaluation: one row a terrain and method, ours beside the paper's, the bound beneath, and
rows over all terrains together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from planner.evaluation import ERROR
from planner.frames import Perception, Status
from planner.intervals import ratio, student, wilson
from planner.methods import COMPARED
from planner.published import GOAL_DISTANCE_M, published
from scenes.scenario import Family

Result = Row = dict[str, Any]

GROUPED_BY: dict[str, Any] = {
    "terrain": "", "method": "", "suite": "random", "observers": "known", "perception": "",
    "goal_distance": GOAL_DISTANCE_M, "placement": "uniform",
}  # fmt: skip
"""What makes a row of the table, with what missions mean that do not say."""

KIND = {name: usual for name, usual in GROUPED_BY.items() if name not in ("terrain", "method")}
"""What sets kinds of missions apart."""

MEANS = (
    "trajectory_length_m", "length_ratio", "execution_time_s", "exposure_fraction", "exposed_s",
    "longest_exposure_s", "detection_probability", "cover_fraction", "concealed_fraction",
    "elevation_gradient_m", "max_tilt_deg", "dynamic_violations",
)  # fmt: skip
"""Columns that are means over the successes."""

WORTH_AVOIDING = 0.5
LIKE_THE_PAPERS = ("random", "covert")
"""Suites whose missions are like those of the paper: nobody walks about."""

ALL_TERRAINS = "all"

REMOVED = "avoidable_removed"
DRAWN_AGAIN = 2000  # times, for the interval of a ratio


def tabulate(missions: Iterable[Result]) -> list[Result]:
    """One row for each group of missions alike in `GROUPED_BY`.

    Means are over the successes that have the figure; `n` says over how many, `ci95` is their interval by
    Student's t, that of `avoidable_removed` by bootstrap over the missions. `paper` is what the paper
    reports for such drives, or None.
    """
    groups = grouped(missions, GROUPED_BY)
    return [_row(key, groups[key]) for key in sorted(groups, key=_order)]


def totals(missions: Iterable[Result]) -> tuple[list[Result], list[Result]]:
    """The rows of `tabulate` and of `bounds` over all terrains together, under the terrain `ALL_TERRAINS`, of
    those kinds of missions that have several and of the methods that drove them all: others would stand
    beside them with other missions. The paper has no figure for that."""
    together: list[Result] = []
    for group in grouped(missions, KIND).values():
        driven: dict[str, set[tuple]] = {}
        for mission in group:
            driven.setdefault(mission["method"], set()).add((mission["terrain"], mission["seed"]))
        every = set().union(*driven.values())
        if len({terrain for terrain, _ in every}) > 1:
            together += [
                mission | {"terrain": ALL_TERRAINS, "seed": (str(mission["terrain"]), mission["seed"])}
                for mission in group
                if driven[mission["method"]] == every
            ]
    return tabulate(together), bounds(together)


def bounds(missions: Iterable[Result]) -> list[Result]:
    """What the route engine makes of the missions, one row a terrain and kind of mission: means over the
    missions for which it has a way. See `planner.suites.Reference`."""
    kinds = {name: usual for name, usual in GROUPED_BY.items() if name != "method"}
    rows = []
    groups = grouped(missions, kinds)
    for key in sorted(groups, key=lambda key: (_order(key[:1]), key)):
        once = {mission["seed"]: mission for mission in groups[key] if mission.get("bound_s") is not None}
        figures = {name: mean(m[name] for m in once.values()) for name in REFERENCE}
        rows.append(dict(zip(kinds, key, strict=True)) | {"missions": len(once)} | figures)
    return rows


REFERENCE = ("shortest_m", "shortest_s", "bound_m", "bound_s")


def grouped(missions: Iterable[Result], kinds: dict[str, Any]) -> dict[tuple, list[Result]]:
    """Missions by what they have under the keys of `kinds`, each group by seed."""
    groups: dict[tuple, list[Result]] = {}
    for mission in missions:
        key = tuple(mission.get(name, usual) for name, usual in kinds.items())
        groups.setdefault(tuple(str(x) if isinstance(x, str) else x for x in key), []).append(mission)
    return {key: sorted(group, key=lambda mission: mission["seed"]) for key, group in groups.items()}


def _order(key: tuple) -> tuple:
    """By terrain, by the kind of mission, and by method as they are usually compared."""
    terrain = len(Family) if key[0] == ALL_TERRAINS else list(Family).index(Family(key[0]))
    if len(key) == 1:
        return (terrain,)
    return terrain, *key[2:], *method_order(key[1])


def method_order(method: str) -> tuple[int, str]:
    """By which methods are sorted, as they are usually compared."""
    return COMPARED.index(method) if method in COMPARED else len(COMPARED), method


def measured(mission: Result, name: str) -> float | None:
    """A figure of one mission, None where it has none."""
    match name:
        case "length_ratio":
            way, straight = mission.get("trajectory_length_m"), mission.get("straight_line_m")
            return way / straight if way is not None and straight else None
        case "max_tilt_deg":
            roll, pitch = mission.get("max_roll_deg"), mission.get("max_pitch_deg")
            return None if roll is None or pitch is None else max(roll, pitch)
        case "success":
            return float(mission["success"])
    return mission.get(name)


def _row(key: tuple, missions: list[Result]) -> Result:
    good = [mission for mission in missions if mission["success"]]
    statuses = Counter(str(mission["status"]) for mission in missions)
    count = len(missions)
    values = {name: [v for m in good if (v := measured(m, name)) is not None] for name in MEANS}
    head = dict(zip(GROUPED_BY, key, strict=True))
    alike = head["goal_distance"] == GOAL_DISTANCE_M and head["perception"] != Perception.ORACLE
    paper = published(head["terrain"], head["method"]) if alike and head["suite"] in LIKE_THE_PAPERS else None
    means = {name: mean(numbers) for name, numbers in values.items()}
    removed, spared, avoidable = avoidable_removed(good)
    return head | {
        "missions": count,
        "successes": len(good),
        "success_rate": len(good) / count,
        "success_ci95": list(wilson(len(good), count)),
        **{name: means[name] for name in MEANS[:7]},
        REMOVED: removed,
        **{name: means[name] for name in MEANS[7:]},
        "collision_rate": statuses[Status.COLLIDED] / count,
        "timeout_rate": statuses[Status.TIMEOUT] / count,
        "failures": {status: n for status, n in sorted(statuses.items()) if status != Status.REACHED},
        "planner_ms_p50": mean(m["planner_ms_p50"] for m in missions if m.get("planner_ms_p50") is not None),
        "paper": None if paper is None else asdict(paper),
        "n": {name: len(numbers) for name, numbers in values.items()} | {REMOVED: len(spared)},
        "ci95": {name: _listed(student(numbers)) for name, numbers in values.items()}
        | {REMOVED: None if removed is None else _listed(ratio(spared, avoidable, DRAWN_AGAIN))},
    }


def avoidable_removed(missions: Iterable[Result]) -> tuple[float | None, list[float], list[float]]:
    """Share of the avoidable exposed seconds that the drives were spared, all missions' seconds together:
    (shortest route's - driven) / (shortest route's - bound). With each mission's two differences.

    None where hardly anything could be avoided, less than `WORTH_AVOIDING` seconds a mission."""
    known = [m for m in missions if m.get("bound_s") is not None and m.get("exposed_s") is not None]
    spared = [mission["shortest_s"] - mission["exposed_s"] for mission in known]
    avoidable = [mission["shortest_s"] - mission["bound_s"] for mission in known]
    enough = known and sum(avoidable) >= WORTH_AVOIDING * len(known)
    return sum(spared) / sum(avoidable) if enough else None, spared, avoidable


def reasons(missions: Iterable[Result]) -> Counter[str]:
    """Why missions ended in an error of ours, and how many."""
    return Counter(mission.get("reason", "") for mission in missions if mission["status"] == ERROR)


def mean(values: Iterable[float]) -> float | None:
    numbers = list(values)
    return float(np.mean(numbers)) if numbers else None


def _listed(interval: tuple[float, float] | None) -> list[float] | None:
    return None if interval is None else list(interval)
