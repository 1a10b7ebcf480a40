"""`/api/scenarios`: documents as files that people can fetch, send, open and import."""

from __future__ import annotations

import asyncio
import tempfile
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BeforeValidator, Field, ValidationError

from app.api.bodies import JsonRoute, read_document
from app.api.upload import read_form
from app.studio import Studio
from app.telemetry import mission_document
from scenes.families import MAX_SIZE
from scenes.scenario import Document, Family, Name, Scenario, ScenarioError

Id = Annotated[str, Path(description="as the list gives it")]
Metre = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
DOCUMENT = {
    "requestBody": {
        "required": True,
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Scenario"}}},
    }
}
FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {"type": "string", "format": "binary"},
                        "crop": {"type": "string", "description": "x y size, in the file's metres"},
                        "resolution": {"type": "number", "description": "metres a cell"},
                        "vertical_scale": {"type": "number"},
                    },
                }
            }
        },
    }
}


class ImportOptions(Document):
    """The form's fields beside the file."""

    crop: (
        Annotated[
            tuple[Metre, Metre, Metre],
            BeforeValidator(lambda text: text.replace(",", " ").split() if isinstance(text, str) else text),
        ]
        | None
    ) = None
    resolution: Annotated[float, Field(allow_inf_nan=False, ge=0.05, le=10.0)] | None = None
    vertical_scale: Annotated[float, Field(allow_inf_nan=False, ge=0.01, le=100.0)] = 1.0


class GeneratorChoice(Document):
    terrain: Family
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]
    size_m: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=24.0, le=MAX_SIZE)] = 48.0


class SaveChoice(Document):
    """A name saves a copy under it; without one the open scenario is saved where it is."""

    name: Name | None = None


def router(studio: Studio) -> APIRouter:
    routes = APIRouter(prefix="/api/scenarios", tags=["scenarios"], route_class=JsonRoute)
    importing = asyncio.Lock()

    @routes.get("")
    async def list_all() -> list[dict[str, Any]]:
        """Shipped ones first, then saved ones: id, name, description, shipped, family, modified."""
        return [asdict(entry) for entry in await asyncio.to_thread(studio.library)]

    @routes.post("", status_code=201, openapi_extra=DOCUMENT)
    async def add(request: Request, response: Response) -> dict[str, str]:
        """Save a document under a new id, without opening it."""
        scenario = await read_document(request, Scenario)
        scenario_id = await studio.add(scenario)
        response.headers["location"] = f"/api/scenarios/{scenario_id}"
        return {"id": scenario_id, "name": scenario.name}

    @routes.post("/generate", status_code=201)
    async def generate(choice: GeneratorChoice) -> dict[str, str]:
        """Make a scenario from a seed and open it; it is not saved yet."""
        await studio.generate(choice.terrain, choice.seed, choice.size_m)
        return {"id": studio.scenario_id, "name": studio.scenario.name}

    @routes.post("/save")
    async def save(choice: SaveChoice) -> dict[str, str]:
        """Save the open scenario with its edits; a shipped one is saved as a copy."""
        scenario_id = studio.save() if choice.name is None else studio.save_as(choice.name)
        return {"id": scenario_id, "name": studio.scenario.name}

    @routes.post("/import", status_code=201, openapi_extra=FORM)
    async def import_survey(request: Request, response: Response) -> dict[str, str]:
        """Make a scenario from a GeoTIFF, LAS or LAZ survey (or a scenario's JSON), save it and open it."""
        folder = studio.store.workspace / "uploads"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as place:
            form = await read_form(request, folder.joinpath(place))
            assert form.file is not None
            options = _options(form.fields)
            try:
                async with importing:  # one at a time: each may fill the memory and a core
                    scenario_id = await studio.import_file(form.file, form.file.name, **options)
            except ScenarioError as error:
                raise ScenarioError(str(error).replace(str(form.file), form.file.name)) from None
        response.headers["location"] = f"/api/scenarios/{scenario_id}"
        return {"id": scenario_id}

    @routes.get("/{id}", responses={200: {"model": Scenario}})
    async def document(id: Id) -> Response:
        """The document as it is saved; the open one, where it was never saved."""
        if id == studio.scenario_id and not studio.store.holds(id):
            text = await asyncio.to_thread(studio.scenario.to_json)
        else:
            text = await asyncio.to_thread(lambda: studio.store.path(id).read_text("utf-8"))
        return Response(text, media_type="application/json")

    @routes.put("/{id}", openapi_extra=DOCUMENT)
    async def replace(id: Id, request: Request) -> dict[str, str]:
        """Replace a saved document; the open scenario stays as it is until it is opened again."""
        scenario = await read_document(request, Scenario)
        await studio.replace(id, scenario)
        return {"id": id, "name": scenario.name}

    @routes.delete("/{id}", status_code=204)
    async def delete(id: Id) -> None:
        """Delete a saved scenario; shipped ones stay."""
        studio.delete(id)

    @routes.post("/{id}/open")
    async def open_one(id: Id) -> dict[str, Any]:
        """Open it in the studio, for all who look on; the robot stands at its start."""
        await studio.open(id)
        return mission_document(studio)

    return routes


def _options(fields: dict[str, str]) -> dict[str, Any]:
    given = {name: text for name, text in fields.items() if text.strip()}
    try:
        options = ImportOptions.model_validate(given)
    except ValidationError as error:
        raise RequestValidationError(error.errors(include_url=False, include_input=False)) from None
    return options.model_dump(exclude_unset=True)
