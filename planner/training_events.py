"""What a training tells of itself while it runs."""

from __future__ import annotations

from dataclasses import dataclass

from planner.ddpg import Losses
from planner.training_collector import StepFrame


@dataclass(frozen=True)
class EpisodeDone:
    """An episode that was driven, kept and, with its checkpoint, safe.

    losses : means over the updates made while it was driven; total : its return; final : its last status
    steps_per_s : of driving and learning together, by the clock, pauses left out
    normalised : return, as `planner.reward.normalised_return` reads the paper
    stage : of the curriculum that its task was of, None without one
    demonstrated : whether a planner drove in the policy's place
    """

    number: int
    steps: int
    total: float
    terms: dict[str, float]
    success: bool
    exposed_s: float
    final: str
    losses: Losses
    updates: int
    steps_per_s: float
    stage: str | None = None
    normalised: float | None = None
    demonstrated: bool = False


@dataclass(frozen=True)
class Stopped:
    """The training is over: all episodes are done, or it was told to stop; what was done is kept."""

    episodes: int
    complete: bool


TrainingEvent = EpisodeDone | StepFrame | Stopped
