"""Which of several policies to ship: each drives the same held-out missions as `covernav_paper`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.checkpoint import PolicyName, load_policy
from planner.intervals import wilson
from planner.mission import Mission
from scenes.families import generate
from scenes.kinematics import KinematicWorld
from scenes.scenario import Family

FIRST_SEED = 7_000_000
"""Of the validation missions: far from the seeds that evaluations and trainings use."""


@dataclass(frozen=True)
class Validation:
    """missions : over all terrains; successes : of these; success_ci95 : Wilson's
    exposed_s : mean visible seconds of a mission, whatever became of it
    failures : how many ended by each reason
    """

    policy: PolicyName
    missions: int
    successes: int
    success_ci95: tuple[float, float]
    exposed_s: float
    failures: dict[str, int]

    @property
    def rank(self) -> tuple[int, float]:
        """Less is better: more successes first, then fewer exposed seconds."""
        return -self.successes, self.exposed_s


def validate(weights: Path, missions: int) -> Validation:
    """Drive `missions` of each terrain by the motion model. Raises PolicyError."""
    _, policy = load_policy(weights)
    summaries = list(_drives(weights, missions))
    good = sum(summary["success"] for summary in summaries)
    ends = [summary["status"] for summary in summaries if not summary["success"]]
    return Validation(
        policy,
        len(summaries),
        good,
        wilson(good, len(summaries)),
        round(float(np.mean([summary["exposed_s"] for summary in summaries])), 3),
        {reason: ends.count(reason) for reason in sorted(set(ends))},
    )


def _drives(weights: Path, missions: int) -> Iterator[dict[str, Any]]:
    for terrain in Family:
        for seed in range(FIRST_SEED, FIRST_SEED + missions):
            with Mission(
                generate(terrain, seed), "covernav_paper", seed, world=KinematicWorld, weights=weights
            ) as mission:
                for _ in mission.frames():
                    pass
                yield mission.summary()


def best(validations: Sequence[Validation]) -> int:
    """Index of the best; of equals the first."""
    return min(range(len(validations)), key=lambda index: validations[index].rank)
