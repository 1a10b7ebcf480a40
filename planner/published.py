"""What the CoverNav paper reports, to stand beside our figures (arXiv 2308.06594, table II).

12 m goals, without numbers of trials; in the forest for CoverNav alone; no figure for exposure.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """success_rate from 0 to 1; trajectory_length_m; execution_time_s of the mission."""

    success_rate: float
    trajectory_length_m: float
    execution_time_s: float


GOAL_DISTANCE_M = 12.0
_TERRAINS = ("normal", "low", "low_high", "forest")
_PAPER = {
    "dwa": ((0.72, 5, 12), (0.82, 4, 14), (0.67, 6, 17)),
    "ga_nav": ((0.79, 6, 14), (0.83, 5, 13), (0.71, 7, 16)),
    "terp": ((0.82, 9, 10), (0.83, 5, 12), (0.69, 7, 20)),
    "covernav": ((0.81, 9, 15), (0.82, 8, 17), (0.70, 7, 22), (0.86, 12, 25)),
}
_SAME = {"covernav_paper": "covernav"}


def published(terrain: str, method: str) -> Published | None:
    """The paper's figures for a method in a terrain; None where it has none."""
    rows = _PAPER.get(_SAME.get(method, method), ())
    row = rows[_TERRAINS.index(terrain)] if terrain in _TERRAINS[: len(rows)] else None
    return None if row is None else Published(row[0], float(row[1]), float(row[2]))
