"""`/api/runs`: missions that were driven; `/api/methods`: the planners to choose from."""

from __future__ import annotations

import asyncio
import math
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query

from app.api.bodies import JsonRoute
from app.store import Store
from planner.methods import METHODS

RunId = Annotated[int, Path(ge=1, le=2**63 - 1)]
ANGLES = ("roll", "pitch", "yaw", "w")


def router(store: Store) -> APIRouter:
    routes = APIRouter(prefix="/api", tags=["runs"], route_class=JsonRoute)

    @routes.get("/runs")
    async def runs(limit: Annotated[int, Query(ge=1, le=1000)] = 200) -> list[dict[str, Any]]:
        """The newest first: id, started_at, scenario_id and what `covernav run --json` gives."""
        return await asyncio.to_thread(store.runs, limit)

    @routes.get("/runs/{id}")
    async def run(id: RunId) -> dict[str, Any]:
        return await asyncio.to_thread(store.run, id)

    @routes.get("/runs/{id}/frames")
    async def frames(id: RunId) -> list[dict[str, Any]]:
        """One row a tick: time_s, x, y, z, roll, pitch, yaw, v and w in metres and degrees; exposure, the
        visible fraction, and detection_probability so far."""
        return await asyncio.to_thread(lambda: [_in_degrees(row) for row in store.frames(id)])

    @routes.get("/methods")
    async def methods() -> list[dict[str, str]]:
        """Name and description of each planner."""
        return [{"name": name, "description": method.description} for name, method in METHODS.items()]

    return routes


def _in_degrees(row: dict[str, float]) -> dict[str, float]:
    return row | {angle: math.degrees(row[angle]) for angle in ANGLES}
