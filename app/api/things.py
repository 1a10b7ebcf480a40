"""`/api/observers`, `/api/cover`, `/api/obstacles`: the same four requests for each kind of thing."""

from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Path, Response
from pydantic import create_model

from app.api.bodies import JsonRoute
from app.changes import COLLECTIONS, Kind, Selection
from app.studio import Studio
from scenes.scenario import CoverSpec, Document, ObserverSpec, ObstacleSpec

Number = Annotated[int, Path(ge=1, le=1_000_000)]

SPECS: dict[Kind, type[Document]] = {
    Kind.OBSERVER: ObserverSpec,
    Kind.COVER: CoverSpec,
    Kind.OBSTACLE: ObstacleSpec,
}


def router(studio: Studio, kind: Kind) -> APIRouter:
    """List, add, change and delete; an edit takes effect in the running mission and can be undone."""
    spec, thing, field = SPECS[kind], COLLECTIONS[kind].model, COLLECTIONS[kind].field
    changes_of = partial_of(spec)
    add, update = getattr(studio, f"add_{kind}"), getattr(studio, f"update_{kind}")
    routes = APIRouter(prefix=f"/api/{field}", tags=[field], route_class=JsonRoute)

    @routes.get("", response_model=list[thing], name=f"list {field}")
    async def list_all() -> Sequence[Document]:
        return getattr(studio.scenario, field)

    @routes.post("", response_model=thing, status_code=201, name=f"add {kind}")
    async def add_one(body: spec, response: Response) -> Document:  # type: ignore[valid-type]
        added = add(body)
        response.headers["location"] = f"/api/{field}/{added.id}"
        return added

    @routes.patch("/{id}", response_model=thing, name=f"change {kind}")
    async def change(id: Number, body: changes_of) -> Document:  # type: ignore[valid-type]
        given: Any = body
        return update(id, {name: getattr(given, name) for name in given.model_fields_set})

    @routes.delete("/{id}", status_code=204, name=f"delete {kind}")
    async def delete(id: Number) -> None:
        studio.remove(Selection(kind, id))

    return routes


def partial_of(spec: type[Document]) -> type[Document]:
    """The spec with every field optional: left out means unchanged; null is what the spec makes of null."""
    kinds: dict[str, Any] = {
        name: Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
        for name, info in spec.model_fields.items()
    }
    fields: dict[str, Any] = {name: (kind | None, None) for name, kind in kinds.items()}
    return create_model(spec.__name__.replace("Spec", "Changes"), __base__=Document, **fields)
