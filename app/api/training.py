"""`/api/training`: trainings of the learner, their curves, and their checkpoints for the running mission."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Path, Response
from pydantic import Field

from app.api.bodies import JsonRoute
from app.studio import Studio
from app.telemetry import mission_document
from app.training_plan import TrainingPlan
from app.training_records import LAST, Training
from app.training_service import TrainingService
from scenes.scenario import Document

LISTED_POINTS = 200
Id = Annotated[int, Path(ge=1, le=2**63 - 1)]


class CheckpointChoice(Document):
    """One of the training's `checkpoints`."""

    checkpoint: Annotated[str, Field(min_length=1, max_length=80)] = LAST


def router(service: TrainingService, studio: Studio) -> APIRouter:
    routes = APIRouter(prefix="/api/training", tags=["training"], route_class=JsonRoute)

    @routes.post("", status_code=201)
    async def start(plan: TrainingPlan, response: Response) -> dict[str, Any]:
        """Begin a training on the scenario that is open (`task` mission, or ground for other drives on its
        ground) or on the curriculum; one at a time."""
        training = await service.start(plan)
        response.headers["location"] = f"/api/training/{training.id}"
        return document(training)

    @routes.get("")
    async def trainings() -> list[dict[str, Any]]:
        """The newest first, with status and curves of at most 200 points."""
        return await asyncio.to_thread(
            lambda: [document(training, LISTED_POINTS) for training in reversed(service.trainings)]
        )

    @routes.get("/{id}")
    async def training(id: Id) -> dict[str, Any]:
        """One training with every episode in its curves."""
        return await asyncio.to_thread(document, service.training(id))

    @routes.post("/{id}/pause")
    async def pause(id: Id) -> dict[str, Any]:
        """Hold after the step that is being driven."""
        return document(service.pause(id), LISTED_POINTS)

    @routes.post("/{id}/resume")
    async def resume(id: Id) -> dict[str, Any]:
        """Go on after a pause, or from the last checkpoint."""
        return document(service.resume(id), LISTED_POINTS)

    @routes.post("/{id}/stop")
    async def stop(id: Id) -> dict[str, Any]:
        """End it; all finished episodes are kept, and it can be resumed."""
        return document(service.stop(id), LISTED_POINTS)

    @routes.delete("/{id}", status_code=204)
    async def delete(id: Id) -> None:
        """Stop a training and remove it with its checkpoints."""
        await service.delete(id)

    @routes.post("/{id}/use")
    async def use(id: Id, choice: CheckpointChoice) -> dict[str, Any]:
        """Put a checkpoint into the running mission; answers with the mission."""
        await service.use(id, choice.checkpoint)
        return mission_document(studio)

    return routes


def document(training: Training, points: int | None = None) -> dict[str, Any]:
    """A training in JSON, its curves thinned to means over at most `points` stretches."""
    return {
        "id": training.id,
        "status": training.status.value,
        "message": training.message,
        "started_at": training.started_at,
        "scenario": training.scenario or None,
        "plan": training.plan.model_dump(mode="json"),
        "episodes": len(training.episodes),
        "checkpoints": list(training.checkpoints()),
        "curves": curves(training.driven, points),
    }


def curves(episodes: Sequence[dict[str, Any]], points: int | None = None) -> dict[str, Any]:
    """Figures by episode: `episode` numbers, `return`, `success`, `exposed_s`, each of the `terms` and of the
    `losses`; null where there is none."""
    size = max(1, -(-len(episodes) // points)) if points else 1

    def thinned(values: list[float | None]) -> list[float | None]:
        if size == 1:
            return values
        stretches = (values[i : i + size] for i in range(0, len(values), size))
        known = ([value for value in stretch if value is not None] for stretch in stretches)
        return [float(np.mean(values)) if values else None for values in known]

    def of(group: str) -> dict[str, list[float | None]]:
        names = dict.fromkeys(name for row in episodes for name in row[group] or {})
        return {name: thinned([(row[group] or {}).get(name) for row in episodes]) for name in names}

    return {
        "episode": [row["number"] + 1 for row in episodes][size - 1 :: size]
        + ([episodes[-1]["number"] + 1] if len(episodes) % size else []),
        "return": thinned([row["total"] for row in episodes]),
        "success": thinned([float(row["success"]) for row in episodes]),
        "exposed_s": thinned([row["exposed_s"] for row in episodes]),
        "terms": of("terms"),
        "losses": of("losses"),
    }
