"""`/api/exposure`: who sees which cell of the scenario, and why."""

from __future__ import annotations

import io
import math
from enum import StrEnum
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Response

from app.api.bodies import JsonRoute
from app.api.things import Number
from app.changes import StudioError
from app.exposure_service import ExposureService
from planner.exposure import ExposureField, SightProfile
from planner.sight_profile import name_of

Metre = Annotated[float, Query(allow_inf_nan=False, ge=-1e6, le=1e6)]


class Format(StrEnum):
    JSON = "json"
    NPY = "npy"


class Layer(StrEnum):
    UNITED = "united"
    COUNT = "count"


class Over(StrEnum):
    NOW = "now"
    BEATS = "beats"


def router(service: ExposureService) -> APIRouter:
    routes = APIRouter(prefix="/api/exposure", tags=["exposure"], route_class=JsonRoute)

    @routes.get("", response_model=None)
    async def exposure(
        format: Format = Format.JSON,
        layer: Layer = Layer.UNITED,
        observer: Annotated[int | None, Query(ge=1, le=1_000_000)] = None,
        over: Over = Over.NOW,
        stride: Annotated[int, Query(ge=1, le=64)] = 1,
    ) -> dict[str, Any] | Response:
        """Shares and areas of the ground on which a robot is seen, by each observer and united: now, or the
        mean `over` the patrols' `beats`.

        With `format=npy` the grid: exposure from 0 to 1 (float32), NaN where the survey has no data, united
        or to one `observer`; or the `count` of observers (int32), -1 where there is no data. Rows go north,
        columns east, over every `stride`-th cell."""
        field = await service.field(stride, averaged=over is Over.BEATS)
        if format is Format.JSON:
            return _figures(field)
        return _grid(field, layer, observer)

    @routes.get("/profile")
    async def profile(observer: Annotated[Number, Query()], x: Metre, y: Metre) -> dict[str, Any]:
        """The line of sight from an observer to a robot at (x, y): whether it is seen, the reason in words,
        what hides it and where, and the section under the line."""
        return _profile(await service.profile(observer, x, y))

    return routes


def _figures(field: ExposureField) -> dict[str, Any]:
    return {
        "x_min": field.x_min,
        "y_min": field.y_min,
        "resolution": field.resolution,
        "rows": field.unknown.shape[0],
        "cols": field.unknown.shape[1],
        "unknown_area_m2": field.unknown_area,
        "united": _share(field, field.united),
        "observers": [{"id": id} | _share(field, field.of(id)) for id in field.observer_ids],
    }


def _share(field: ExposureField, exposure: np.ndarray) -> dict[str, float]:
    return {
        "fraction": round(field.share(exposure), 6),
        "area_m2": round(field.area(exposure), 4),
        "mean": round(field.mean(exposure), 6),
    }


def _grid(field: ExposureField, layer: Layer, observer: int | None) -> Response:
    if observer is not None:
        if observer not in field.observer_ids:
            raise StudioError(f"there is no observer {observer}", 404)
        grid = field.of(observer)
    else:
        grid = field.count if layer is Layer.COUNT else field.united
    content = io.BytesIO()
    np.save(content, grid, allow_pickle=False)
    headers = {"content-disposition": 'attachment; filename="exposure.npy"'}
    return Response(content.getvalue(), media_type="application/octet-stream", headers=headers)


def _profile(profile: SightProfile) -> dict[str, Any]:
    body, point = profile.blocker, profile.point
    blocker = None if body is None else {"kind": body.kind.value, "id": body.id, "name": name_of(body)}
    return {
        "observer": profile.observer_id,
        "seen": profile.seen,
        "light": round(profile.light, 4),
        "reason": profile.reason,
        "blocked_by": blocker,
        "blocking_point": None if point is None else _point(point),
        "eye": _point(profile.eye),
        "target": _point(profile.target),
        "distance_m": _metres(profile.distance),
        "ground_m": _metres(profile.ground),
        "cover_m": _metres(profile.cover),
        "sight_m": _metres(profile.sight),
    }


def _point(point: np.ndarray) -> dict[str, float]:
    return {axis: round(float(value), 3) for axis, value in zip("xyz", point, strict=True)}


def _metres(values: np.ndarray) -> list[float | None]:
    return [round(value, 3) if math.isfinite(value) else None for value in values.tolist()]
