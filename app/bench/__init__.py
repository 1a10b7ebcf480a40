"""`covernav bench`: our own speed beside a peer's, measured in the same run, results compared."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any

from app.bench.driving import covert_mission_speed, covert_tick, mission_speed, tick
from app.bench.exposure import united_exposure
from app.bench.learning import policy_decision, training
from app.bench.line_of_sight import viewshed
from app.bench.measure import Result
from app.bench.planning import dwa_cycle
from app.bench.routing import covert_route, space_time
from app.bench.sensing import lidar_turn, scan_to_patch, semantic_image
from app.bench.serving import click_to_goal, drag_to_overlay

CASES: dict[str, Callable[[], Result]] = {
    case.__name__: case
    for case in (
        dwa_cycle,
        lidar_turn,
        scan_to_patch,
        semantic_image,
        tick,
        mission_speed,
        covert_tick,
        covert_mission_speed,
        click_to_goal,
        drag_to_overlay,
        viewshed,
        united_exposure,
        covert_route,
        space_time,
        training,
        policy_decision,
    )
}

PEERS_TO_INSTALL = {"training": "stable_baselines3", "policy_decision": "stable_baselines3"}
"""Peers that do not come with the studio: without them their cases are left out."""


def run(only: str | None = None) -> list[dict[str, Any]]:
    """Run every case, or the one called `only`; each as a dict of the fields of `Result`.

    Raises ValueError for a name that is not in CASES, or whose peer is not installed."""
    if only is not None and only not in CASES:
        raise ValueError(f"there is no bench {only!r}; choose one of {', '.join(CASES)}")
    results = []
    for name, case in CASES.items():
        if only in (None, name):
            missing = name in PEERS_TO_INSTALL and find_spec(PEERS_TO_INSTALL[name]) is None
            if missing and only is None:
                print(f"{name} is left out: {_how_to_install(name)}", file=sys.stderr)
                continue
            if missing:
                raise ValueError(f"the bench {name!r} {_how_to_install(name)}")
            if sys.stderr.isatty():
                print(f"{name} …", file=sys.stderr, flush=True)
            results.append(asdict(case()))
    return results


def _how_to_install(name: str) -> str:
    return f"needs {PEERS_TO_INSTALL[name]}; install the studio with its extra, pip install '.[bench]'"


def table(results: list[dict[str, Any]]) -> str:
    """Results as aligned text, the peer and the comparison of results below each."""
    rows = [("", "ours", "peer", "ratio", "unit")]
    rows += [(r["name"], f"{r['ours']:g}", f"{r['peer']:g}", f"{r['ratio']:g}×", r["unit"]) for r in results]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = []
    for index, row in enumerate(rows):
        numbers = "  ".join(cell.rjust(width) for cell, width in zip(row[1:4], widths[1:4], strict=True))
        lines.append(f"{row[0].ljust(widths[0])}  {numbers}  {row[4]}")
        if index:
            lines.append(f"    peer: {results[index - 1]['peer_name']}")
            lines.append(f"    same: {results[index - 1]['identical']}")
    return "\n".join(lines)
