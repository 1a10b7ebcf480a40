"""A training that is over in seconds, and waiting for one."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

from served import silent_studio

from app.studio import Studio
from app.training_plan import TrainingPlan, TrainingStatus
from app.training_records import Training
from app.training_service import TrainingService
from scenes.scenario import Scenario

PATIENCE_S = 240.0  # the learner's libraries alone take half a minute on a busy machine
SHORT = TrainingPlan(task="mission", episodes=3, steps=4, seed=1)
LONG = TrainingPlan(task="mission", episodes=1000, steps=4, seed=1)


def opened(workspace: Path, scenario: Scenario) -> tuple[Studio, TrainingService]:
    """A studio without its mission process, and its trainings."""
    studio = silent_studio(workspace, scenario)
    return studio, TrainingService(studio)


async def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "that did not come about"
        await asyncio.sleep(0.05)


async def over(training: Training) -> TrainingStatus:
    await until(lambda: not training.status.live)
    return training.status
