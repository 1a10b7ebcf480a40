"""Every refusal as {"detail": one sentence}, with the HTTP status that fits."""

from __future__ import annotations

import errno
import logging
from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, HTTPException, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException as StarletteHTTPException

from app.changes import StudioError
from app.security import SECURITY_HEADERS
from app.store import StoreError, UnknownEntry
from scenes.document import ScenarioError, in_words

log = logging.getLogger(__name__)

MOST_PROBLEMS = 5
PLACES = ("body", "path", "query", "header")


def install(app: FastAPI) -> None:
    """Give the app its answers to what can go wrong."""
    app.add_exception_handler(RequestValidationError, _invalid)  # type: ignore[arg-type]
    app.add_exception_handler(StarletteHTTPException, _http)  # type: ignore[arg-type]
    app.add_exception_handler(StudioError, _refused)  # type: ignore[arg-type]
    app.add_exception_handler(ScenarioError, _unusable)
    app.add_exception_handler(UnknownEntry, _unknown)
    app.add_exception_handler(StoreError, _not_stored)
    app.add_exception_handler(Exception, _ours)


def told(problems: Sequence[Any]) -> str:
    """Validation problems as text: each field's path and what would be right there."""
    lines = [_told(problem) for problem in problems[:MOST_PROBLEMS]]
    if len(problems) > MOST_PROBLEMS:
        lines.append(f"and {len(problems) - MOST_PROBLEMS} more")
    return "; ".join(lines).encode("utf-8", "replace").decode()


def _told(problem: Any) -> str:
    place = problem["loc"]
    inner = place[1:] if len(place) > 1 and place[0] in PLACES else place
    return in_words(problem | {"loc": inner})


def _answer(status: int, detail: str, headers: Any = None) -> JSONResponse:
    return JSONResponse({"detail": detail}, status, headers)


async def _invalid(request: Request, error: RequestValidationError) -> JSONResponse:
    return _answer(422, told(error.errors()))


async def _http(request: Request, error: HTTPException) -> JSONResponse:
    detail = str(error.detail)
    if error.status_code == 404 and detail == HTTPStatus.NOT_FOUND.phrase:
        detail = "there is nothing at this address; /api/docs lists what there is"
    return _answer(error.status_code, detail, error.headers)


async def _refused(request: Request, error: StudioError) -> JSONResponse:
    return _answer(error.status, str(error))


async def _unusable(request: Request, error: Exception) -> JSONResponse:
    return _answer(422, str(error))


async def _unknown(request: Request, error: Exception) -> JSONResponse:
    return _answer(404, str(error.args[0]) if error.args else "there is no such thing")


async def _not_stored(request: Request, error: Exception) -> JSONResponse:
    log.error("%s", error)
    return _answer(507, str(error))


async def _ours(request: Request, error: Exception) -> JSONResponse:
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return _answer(507, "the disk is full: make room and try again", SECURITY_HEADERS)
    return _answer(500, "that failed for a reason of ours; the server's log has it", SECURITY_HEADERS)
