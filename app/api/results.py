"""`/api/results`: evaluations of `covernav evaluate --out`, their tables, figures, maps and replays."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, HTTPException, Path, Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import Field, StrictInt

from app.api.bodies import JsonRoute
from app.results import Evaluation, ResultsLibrary, described
from app.results_map import Ground, Grounds
from app.results_replay import ReplayService
from app.results_store import FIGURES
from app.results_style import colour_of
from app.results_tables import csv_missions, csv_table, kind_words
from app.telemetry import mission_document
from planner.trajectory import Trajectory
from scenes.scenario import Document

Id = Annotated[str, Path(description="as the list gives it", max_length=80)]
MissionId = Annotated[int, Path(ge=1, le=2**63 - 1)]
Kind = Annotated[int, Query(ge=0, le=10_000, description="place in the evaluation's `kinds`")]
Theme = Annotated[str, Query(pattern="^(dark|light)$")]
LISTED = ("id", "terrain", "method", "seed", "status", "success", "drawn", *FIGURES[:10])
UPLOAD = {
    "requestBody": {
        "required": True,
        "content": {"application/vnd.sqlite3": {"schema": {"type": "string", "format": "binary"}}},
    }
}


class ReplayChoice(Document):
    """One mission or two of the same scene, by their ids; the scene opens in the studio."""

    missions: Annotated[tuple[StrictInt, ...], Field(min_length=1, max_length=2)]


class Reports:
    """What is asked of files and figures, beside the event loop."""

    def __init__(self, library: ResultsLibrary, grounds: Grounds) -> None:
        self.library, self.grounds = library, grounds

    def overview(self, id: str) -> dict[str, Any]:
        found = self.library.get(id)
        methods = [
            {"name": name, "description": described(name), "colour": colour_of(name, False)}
            for name in found.methods
        ]
        kinds = [
            kind | {"number": number, "words": kind_words(kind), "missions": len(found.of_kind(number))}
            for number, kind in enumerate(found.kinds)
        ]
        return {
            "id": id, "title": found.title, "methods": methods, "kinds": kinds, "rows": found.rows,
            "bounds": found.bounds, "totals": found.totals[0], "total_bounds": found.totals[1],
        }  # fmt: skip

    def missions(self, id: str, kind: int) -> list[dict[str, Any]]:
        found = self.library.get(id)
        return [
            {name: mission.get(name) for name in LISTED} | {"label": str(mission["seed"])}
            for mission in found.of_kind(kind)
        ]

    def scene(self, id: str, mission: int) -> dict[str, Any]:
        found = self.library.get(id)
        ground, drives = self.grounds.of(found.recipe(mission)), found.drives(mission)
        return {
            "name": ground.scenario.name, "bounds": ground.bounds,
            "view": ground.view([drive.trajectory for drive in drives]),
            "start": ground.start, "goal": ground.goal,
            "watchers": [
                {"x": one.x, "y": one.y, "known": one.known, "sector": one.sector} for one in ground.watchers
            ],
            "drives": [
                {name: drive.mission.get(name) for name in LISTED} | _way(drive.trajectory)
                for drive in drives
            ],
        }  # fmt: skip

    def ground(self, id: str, mission: int) -> Ground:
        return self.grounds.of(self.library.get(id).recipe(mission))

    def figure(self, id: str, name: str, kind: int, mission: int | None, theme: str, format: str) -> bytes:
        from app import results_figures

        draw = self._drawing(self.library.get(id), name, kind, mission)
        return results_figures.render(draw, results_figures.Theme(theme), format)

    def _drawing(self, found: Evaluation, name: str, kind: int, mission: int | None) -> Callable:
        from app import results_figures

        chosen = found.kind(kind)
        match name:
            case "success-exposure":
                rows, bounds = _alike(found.rows, chosen), _alike(found.bounds, chosen)
                return partial(results_figures.success_against_exposure, rows, bounds)
            case "distributions":
                return partial(results_figures.distributions, found.of_kind(kind), found.methods)
            case "trajectories" if mission is not None:
                ways = [(drive.mission["method"], drive.trajectory) for drive in found.drives(mission)]
                return partial(results_figures.trajectories, self.grounds.of(found.recipe(mission)), ways)
        raise HTTPException(
            404, "there is no such figure: success-exposure, distributions, or trajectories with a mission"
        )

    def report(self, id: str) -> str:
        from app.results_report import page

        return page(self.library.get(id), self.grounds)



def _alike(rows: list[dict[str, Any]], kind: dict[str, Any]) -> list[dict[str, Any]]:
    return [row for row in rows if all(row[name] == kind[name] for name in kind)]


def _way(way: Trajectory) -> dict[str, list[float]]:
    columns = {"time_s": way.time_s, "x": way.x, "y": way.y, "seen": way.seen}
    return {name: np.round(values, 3).tolist() for name, values in columns.items()}


def _attached(content: str | bytes, media_type: str, name: str, inline: bool = False) -> Response:
    how = "inline" if inline else "attachment"
    headers = {"content-disposition": f'{how}; filename="{name}"'}
    return Response(content, media_type=media_type, headers=headers)


def router(library: ResultsLibrary, replays: ReplayService) -> APIRouter:
    routes = APIRouter(prefix="/api/results", tags=["results"], route_class=JsonRoute)
    reports = Reports(library, Grounds())

    @routes.get("")
    async def evaluations() -> list[dict[str, Any]]:
        """The sample first: id, title, missions, methods, terrains, and `problem` of a damaged file."""
        return await asyncio.to_thread(library.entries)

    @routes.post("", status_code=201, openapi_extra=UPLOAD)
    async def add(request: Request, response: Response) -> dict[str, str]:
        """Take over the `results.sqlite` of an evaluation's folder, sent as the body."""
        kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if kind not in ("application/vnd.sqlite3", "application/x-sqlite3", "application/octet-stream"):
            raise HTTPException(415, "send the file itself with Content-Type: application/vnd.sqlite3")
        folder = replays.studio.store.workspace / "uploads"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as place:
            file = FilePath(place) / "upload.sqlite"
            with file.open("wb") as stream:
                async for chunk in request.stream():
                    stream.write(chunk)
            results_id = await asyncio.to_thread(library.add, file)
        response.headers["location"] = f"/api/results/{results_id}"
        return {"id": results_id}

    @routes.get("/{id}")
    async def overview(id: Id) -> dict[str, Any]:
        """The table with the paper's figures and intervals, the bound, methods and kinds of missions."""
        return await asyncio.to_thread(reports.overview, id)

    @routes.delete("/{id}", status_code=204)
    async def delete(id: Id) -> None:
        """Delete one from the workspace; the sample stays."""
        await asyncio.to_thread(library.delete, id)

    @routes.get("/{id}/missions")
    async def missions(id: Id, kind: Kind = 0) -> list[dict[str, Any]]:
        """Every drive of a kind of missions, with its figures."""
        return await asyncio.to_thread(reports.missions, id, kind)

    @routes.get("/{id}/paired")
    async def paired(
        id: Id, method: Annotated[str, Query(max_length=200)], against: Annotated[str, Query(max_length=200)]
    ) -> list[dict[str, Any]]:
        """Mean differences of two methods on the same missions, with 95 % intervals."""
        return await asyncio.to_thread(lambda: library.get(id).paired(method, against))

    @routes.get("/{id}/scenes/{mission}")
    async def scene(id: Id, mission: MissionId) -> dict[str, Any]:
        """A mission from above: its map's bounds, the part driven through, watchers, every method's way."""
        return await asyncio.to_thread(reports.scene, id, mission)

    @routes.get("/{id}/scenes/{mission}/map.jpg")
    async def map_picture(id: Id, mission: MissionId) -> Response:
        """Its ground and cover, north up, over the scene's `bounds`."""
        picture = await asyncio.to_thread(lambda: reports.ground(id, mission).jpeg())
        return Response(picture, media_type="image/jpeg", headers={"cache-control": "private, max-age=3600"})

    @routes.get("/{id}/figures/{name}.{format}")
    async def figure(
        id: Id,
        name: Annotated[str, Path(max_length=40)],
        format: Annotated[str, Path(pattern="^(svg|png)$")],
        kind: Kind = 0,
        mission: Annotated[int | None, Query(ge=1, le=2**63 - 1)] = None,
        theme: Theme = "light",
    ) -> Response:
        """`success-exposure`, `distributions`, or with a mission `trajectories`."""
        picture = await asyncio.to_thread(reports.figure, id, name, kind, mission, theme, format)
        media = "image/svg+xml" if format == "svg" else "image/png"
        return _attached(picture, media, f"{id}-{name}.{format}", inline=True)

    @routes.get("/{id}/table.csv")
    async def table_csv(id: Id) -> Response:
        """The table, one line a terrain, method and kind of mission, with intervals and counts."""
        found = await asyncio.to_thread(library.get, id)
        return _attached(csv_table(*found.table), "text/csv; charset=utf-8", f"{id}-table.csv")

    @routes.get("/{id}/missions.csv")
    async def missions_csv(id: Id) -> Response:
        """Every mission's figures."""
        text = await asyncio.to_thread(lambda: csv_missions(library.get(id).missions))
        return _attached(text, "text/csv; charset=utf-8", f"{id}-missions.csv")

    @routes.get("/{id}/report.html")
    async def report(id: Id) -> Response:
        """One page with everything in it: tables, figures, a mission a terrain."""
        text = await asyncio.to_thread(reports.report, id)
        return _attached(text, "text/html; charset=utf-8", f"{id}-report.html")

    @routes.get("/{id}/file")
    async def file(id: Id) -> Response:
        """The SQLite file itself."""
        path = await asyncio.to_thread(library.path, id)
        return FileResponse(path, media_type="application/vnd.sqlite3", filename=f"{id}.sqlite")

    @routes.post("/{id}/replay")
    async def replay(id: Id, choice: ReplayChoice) -> dict[str, Any]:
        """Open the missions' scene in the studio, for all who look on, and play their drives as ghosts."""
        found = await asyncio.to_thread(library.get, id)
        await replays.open(found, choice.missions)
        return mission_document(replays.studio)

    return routes
