"""Request bodies: how large they may be, how long they may take, and JSON that means one thing only."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from fastapi import HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel, ValidationError
from pydantic_core import from_json
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from scenes.scenario import MAX_FILE_BYTES

MiB = 2**20
MAX_BODY = 1 * MiB
MAX_UPLOAD = 512 * MiB
MAX_RESULTS = 64 * MiB
UPLOAD_PATH = "/api/scenarios/import"
RESULTS_PATH = "/api/results"
DOCUMENT_PATHS = re.compile(r"/api/scenarios(/[^/]+)?")
BODY_PAUSE_S = 30.0

Model = TypeVar("Model", bound=BaseModel)


def body_limit(path: str) -> int:
    """Largest body in bytes that an address takes; an upload's form around the file counts too."""
    if path == UPLOAD_PATH:
        return MAX_UPLOAD
    if path == RESULTS_PATH:
        return MAX_RESULTS
    return MAX_FILE_BYTES if DOCUMENT_PATHS.fullmatch(path) else MAX_BODY


class BodyLimit:
    """ASGI middleware: answers 413 before reading where the announced length is too large, and while reading
    where what comes is more; 408 where a body stops coming."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        limit = body_limit(scope["path"])
        announced = dict(scope["headers"]).get(b"content-length", b"0")
        if len(announced.strip()) > 15 or not announced.strip().isdigit() or int(announced) > limit:
            response = JSONResponse({"detail": _too_large(limit)}, 413, {"connection": "close"})
            await response(scope, receive, send)
            return
        await self.app(scope, _limited(receive, limit), send)


def _limited(receive: Receive, limit: int) -> Receive:
    received, complete = 0, False

    async def receive_within_limit() -> Message:
        nonlocal received, complete
        try:
            async with asyncio.timeout(None if complete else BODY_PAUSE_S):
                message = await receive()
        except TimeoutError:
            raise HTTPException(408, "the body stopped coming", {"connection": "close"}) from None
        if message["type"] == "http.request":
            complete = not message.get("more_body", False)
            received += len(message.get("body", b""))
            if received > limit:
                raise HTTPException(413, _too_large(limit), {"connection": "close"})
        return message

    return receive_within_limit


def _too_large(limit: int) -> str:
    return f"the body is too large: this address takes at most {limit // MiB} MiB"


class _JsonRequest(Request):
    """Parses JSON with bounded depth and without lone surrogates; NaN is left for the fields to refuse."""

    async def json(self) -> Any:
        try:
            return from_json(await self.body())
        except ValueError as error:
            raise HTTPException(422, f"the body is not JSON: {error}") from None


class JsonRoute(APIRoute):
    """A route whose body, if it takes one, must be JSON."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handler = super().get_route_handler()

        async def strict_handler(request: Request) -> Response:
            if self.body_field is not None:
                expect_json(request)
            return await handler(_JsonRequest(request.scope, request.receive))

        return strict_handler


def expect_json(request: Request) -> None:
    """Raises HTTPException 415 where a body of another kind is announced."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise HTTPException(415, "the body must be JSON: send it with Content-Type: application/json")


async def read_document(request: Request, model: type[Model]) -> Model:
    """A large JSON body as a model, parsed and checked beside the event loop.

    Raises HTTPException, RequestValidationError."""
    expect_json(request)
    body = await request.body()
    try:
        return await asyncio.to_thread(model.model_validate_json, body)
    except ValidationError as error:
        raise RequestValidationError(error.errors(include_url=False, include_input=False)) from None
