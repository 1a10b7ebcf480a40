"""`/api/route`: covert routes through the scenario that is open."""

from __future__ import annotations

import math
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from app.api.bodies import JsonRoute
from app.changes import StudioError
from app.exposure_service import ExposureService, Moment
from planner.covert_route import CovertPlanner, CovertRoute
from planner.exposure import common_cycle
from planner.no_route import NoRoute
from planner.space_time import SpaceTimePlanner
from scenes.rays import RayScene
from scenes.scenario import Document, Point, between


class RouteRequest(Document):
    """From 0, the shortest way, to 1, the most hidden one."""

    start: Annotated[Point, Field(alias="from")]
    goal: Annotated[Point, Field(alias="to")]
    exposure_weight: Annotated[float, between(0.0, 1.0)] = 0.5


def router(service: ExposureService) -> APIRouter:
    routes = APIRouter(prefix="/api", tags=["exposure"], route_class=JsonRoute)

    @routes.post("/route")
    async def route(request: RouteRequest) -> dict[str, Any]:
        """The least-cost route over slope, obstacles and exposure to all observers, with the figures of a
        drive along it. Where observers walk, a route with a weight above 0 is planned against the clock:
        `times` says when each point is due, `waits` where to stand still in cover."""

        def answer(moment: Moment, rays: RayScene) -> CovertRoute:
            planner = CovertPlanner(moment.heightmap, moment.cover, moment.observers, rays)
            ends = (request.start.x, request.start.y), (request.goal.x, request.goal.y)
            if request.exposure_weight > 0.0 and common_cycle(moment.observers):
                return SpaceTimePlanner(planner, moment.time_s).route(*ends, request.exposure_weight)
            return planner.route(*ends, request.exposure_weight)

        try:
            return document(await service.ask(answer))
        except NoRoute as reason:
            raise StudioError(f"there is no route: {reason}") from None

    return routes


def document(route: CovertRoute) -> dict[str, Any]:
    """A route in JSON: metres and seconds."""
    return {
        "points": [[round(float(x), 3), round(float(y), 3)] for x, y in route.points],
        "length_m": route.length_m,
        "duration_s": route.duration_s,
        "exposure_s": route.exposed_s,
        "exposure_fraction": route.exposure_fraction,
        "longest_exposure_s": route.longest_exposure_s,
        "detection_probability": route.detection_probability,
        "cost": route.cost if math.isfinite(route.cost) else None,
        "times": None if route.times is None else [round(float(time_s), 2) for time_s in route.times],
        "waits": [
            {"x": x, "y": y, "from_s": since, "until_s": until} for (x, y), since, until in route.waits
        ],
    }
