"""`CoverNav-v0` on a scenario that its options carry as a document, so that a training's own settings hold
all that it depends on: `app.training_drive:StudioDrive-v0` for `gymnasium.make`."""

from __future__ import annotations

from typing import Any

import gymnasium

from planner.environment import CoverNavEnv
from scenes.scenario import Scenario

ENVIRONMENT = "app.training_drive:StudioDrive-v0"


def studio_drive(document: str, **options: Any) -> CoverNavEnv:
    """The environment on the scenario in `document`. Raises ValueError for a document that is none."""
    return CoverNavEnv(scenario=Scenario.model_validate_json(document), **options)


gymnasium.register(id="StudioDrive-v0", entry_point=studio_drive)
