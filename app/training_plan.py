"""What a person asks of a training, and where a training can stand."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from scenes.scenario import Document

MOST_DEMONSTRATIONS = 90
"""Per cent of the episodes; the rest is the policy's."""


class Task(StrEnum):
    """What is learnt on: the open scenario as it stands, other drives on its ground, or the curriculum from a
    goal 4 m away to 50 m through a watched forest."""

    MISSION = "mission"
    GROUND = "ground"
    CURRICULUM = "curriculum"


class RewardName(StrEnum):
    PAPER = "paper"
    CORRECTED = "corrected"


class DynamicsName(StrEnum):
    KINEMATIC = "kinematic"
    PHYSICS = "physics"


class TrainingPlan(Document):
    """steps : of an episode at most, 100 where it is left out; stages of the curriculum have their own
    demonstrations : per cent of the episodes that a planner drives, for the policy to learn from
    """

    task: Task = Task.CURRICULUM
    reward: RewardName = RewardName.CORRECTED
    dynamics: DynamicsName = DynamicsName.KINEMATIC
    episodes: Annotated[int, Field(strict=True, ge=1, le=100_000)] = 100
    steps: Annotated[int, Field(strict=True, ge=1, le=2_000)] | None = None
    seed: Annotated[int, Field(strict=True, ge=0, le=2**31 - 1)] = 0
    demonstrations: Annotated[int, Field(strict=True, ge=0, le=MOST_DEMONSTRATIONS)] = 0


class TrainingStatus(StrEnum):
    """`starting` until the first episode is on its way, `interrupted` where the studio or the process ended
    in its middle, `failed` where it could not go on."""

    STARTING = "starting"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    INTERRUPTED = "interrupted"
    FAILED = "failed"
    DONE = "done"

    @property
    def live(self) -> bool:
        """Whether a process is at work on it."""
        return self in (
            TrainingStatus.STARTING, TrainingStatus.RUNNING, TrainingStatus.PAUSED, TrainingStatus.STOPPING
        )  # fmt: skip
