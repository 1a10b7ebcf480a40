"""Two methods on the same missions: mean differences with 95 % intervals, by the seed's pair of drives."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from planner.evaluation_table import ALL_TERRAINS, KIND, Result, grouped, mean, measured
from planner.intervals import paired_rates, student
from scenes.scenario import Family

OVER_ALL, OVER_SUCCESSES = ("max_tilt_deg",), ("exposed_s", "execution_time_s", "elevation_gradient_m")
"""Measures of every pair, and of those in which both arrived: a drive that ended early is seen less."""


def paired(missions: Iterable[Result], method: str, against: str) -> list[Result]:
    """`method` less `against`, one row a terrain and kind of mission, and one over all terrains.

    `success` is the difference of the rates (Newcombe's interval for pairs), the others that of the means
    (Student's t on the pairs' differences; None for fewer than two pairs): `{n, difference, ci95}` each.
    """
    wanted = [mission for mission in missions if mission["method"] in (method, against)]
    rows = []
    for key, group in sorted(grouped(wanted, KIND).items()):
        found = _pairs(group, method, against)
        terrains = [family.value for family in Family if any(one["terrain"] == family for one, _ in found)]
        for terrain in [*terrains, *([ALL_TERRAINS] if len(terrains) > 1 else [])]:
            part = [pair for pair in found if terrain in (pair[0]["terrain"], ALL_TERRAINS)]
            head = {"terrain": terrain, "method": method, "against": against}
            rows.append(head | dict(zip(KIND, key, strict=True)) | _differences(part))
    return rows


def _pairs(missions: list[Result], method: str, against: str) -> list[tuple[Result, Result]]:
    by_mission: dict[tuple, dict[str, Result]] = {}
    for mission in missions:
        by_mission.setdefault((str(mission["terrain"]), mission["seed"]), {})[mission["method"]] = mission
    return [
        (drives[method], drives[against])
        for _, drives in sorted(by_mission.items())
        if method in drives and against in drives
    ]


def _differences(pairs: list[tuple[Result, Result]]) -> dict[str, Any]:
    arrived = [pair for pair in pairs if pair[0]["success"] and pair[1]["success"]]
    row: dict[str, Any] = {"missions": len(pairs), "success": _success(pairs)}
    for names, part in ((OVER_SUCCESSES, arrived), (OVER_ALL, pairs)):
        for name in names:
            row[name] = _difference(part, name)
    return row


def _success(pairs: list[tuple[Result, Result]]) -> dict[str, Any]:
    only = [bool(one["success"]) - bool(other["success"]) for one, other in pairs]
    both = sum(bool(one["success"] and other["success"]) for one, other in pairs)
    first, second = only.count(1), only.count(-1)
    interval = paired_rates(both, first, second, len(pairs) - both - first - second)
    return {"n": len(pairs), "difference": mean(only), "ci95": list(interval)}


def _difference(pairs: list[tuple[Result, Result]], name: str) -> dict[str, Any]:
    values = []
    for one, other in pairs:
        here, there = measured(one, name), measured(other, name)
        if here is not None and there is not None:
            values.append(here - there)
    interval = student(values)
    ci95 = None if interval is None else list(interval)
    return {"n": len(values), "difference": mean(values), "ci95": ci95}
