"""Learning curves over several seeds: what trainings that differ in nothing but their seed have in common."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from planner.learning_errors import TrainingRefusal

BLOCK = 10
"""Episodes that make a point of a curve."""

BOUNDS = {"success": (0.0, 1.0), "collided": (0.0, 1.0), "exposed_s": (0.0,), "steps": (0.0,)}
"""Of the figures that have any, the least and the most."""


@dataclass(frozen=True)
class Curve:
    """A figure by blocks of episodes, over the seeds.

    mean : (blocks,); low, high : (blocks,) 95 % interval of the mean, Student's over the seeds' own means,
        cut off where the figure can go no further; the mean itself for a single seed
    """

    mean: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def curve(seeds: Sequence[Sequence[float]], least: float = -np.inf, most: float = np.inf) -> Curve:
    """Of one figure per episode, a sequence a seed; blocks that a seed did not finish are left out.

    least, most : between which the figure lies, whatever happens"""
    blocks = min(len(values) for values in seeds) // BLOCK
    means = np.array([np.reshape(values[: blocks * BLOCK], (blocks, BLOCK)).mean(1) for values in seeds])
    centre, half = means.mean(0), np.zeros(blocks)
    if len(means) > 1:
        error = means.std(0, ddof=1) / np.sqrt(len(means))
        half = stats.t.ppf(0.975, len(means) - 1) * error
    lines = centre, np.maximum(centre - half, least), np.minimum(centre + half, most)
    return Curve(*(tuple(np.round(line, 3).tolist()) for line in lines))


def summarise(folders: Iterable[Path]) -> dict[str, Any]:
    """The trainings in these folders by their settings but for the seed, as a document.

    Raises TrainingRefusal for a folder that holds no training."""
    groups: dict[str, list[tuple[dict[str, Any], list[dict[str, Any]]]]] = defaultdict(list)
    for folder in folders:
        settings, rows = _read(folder)
        groups[json.dumps({**settings, "seed": None}, sort_keys=True)].append((settings, rows))
    return {"block": BLOCK, "groups": [_group(members) for members in groups.values()]}


def _read(folder: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    try:
        settings = json.loads((folder / "settings.json").read_text())
        rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    except (OSError, ValueError) as error:
        raise TrainingRefusal(f"{folder} holds no training to summarise: {error}") from None
    return settings, rows


def _group(members: Sequence[tuple[Mapping[str, Any], Sequence[Mapping[str, Any]]]]) -> dict[str, Any]:
    members = sorted(members, key=lambda member: member[0]["seed"])
    settings = members[0][0]
    runs = [[row for row in rows if not row.get("demonstrated")] for _, rows in members]
    figures = {
        "return": [[row["total"] for row in rows] for rows in runs],
        "success": [[float(row["success"]) for row in rows] for rows in runs],
        "collided": [[float(row["final"] == "collided") for row in rows] for rows in runs],
        "exposed_s": [[row["exposed_s"] for row in rows] for rows in runs],
        "steps": [[row["steps"] for row in rows] for rows in runs],
    }
    terms = sorted({name for rows in runs for row in rows for name in row["terms"]})
    for name in terms:
        figures[f"terms/{name}"] = [[row["terms"].get(name, 0.0) for row in rows] for rows in runs]
    return {
        "options": settings["options"],
        "seeds": [member["seed"] for member, _ in members],
        "episodes": min(len(rows) for rows in runs),
        "steps": [sum(row["steps"] for row in rows) for rows in runs],
        "curves": {name: vars(curve(values, *BOUNDS.get(name, ()))) for name, values in figures.items()},
    }
