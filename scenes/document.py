"""What all documents share: strict, bounded fields, one clear message for what is wrong, safe files."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

MOST_FIELDS = 64


def between(low: float, high: float) -> Any:
    """Field constraint: a finite number from `low` to `high`; no truth values, no digits in quotes."""
    return Field(strict=True, allow_inf_nan=False, ge=low, le=high)


Coordinate = Annotated[float, between(-5000.0, 5000.0)]
Degrees = Annotated[float, between(-360.0, 360.0)]
MAX_ID = 1_000_000
Identifier = Annotated[int, Field(strict=True, ge=1, le=MAX_ID)]
Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f<>]+$")]


PLAIN_WORDS = {
    "missing": "is missing",
    "extra_forbidden": "is not a field that is known here",
    "too_long": "has too many items: at most {max_length} are allowed",
    "too_short": "has too few items: at least {min_length} must be given",
}


class ScenarioError(ValueError):
    """A scenario that cannot be used; the message names the place and what would be right."""


class Document(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    @model_validator(mode="before")
    @classmethod
    def _few_fields(cls, data: Any) -> Any:
        """A million unknown fields would each be looked at and reported, for many seconds."""
        if isinstance(data, dict) and len(data) > MOST_FIELDS:
            raise ValueError(f"has {len(data)} fields; at most {MOST_FIELDS} are read")
        return data


def several(most: int, least: int = 0) -> Any:
    """Field constraint: from `least` to `most` items, of which the first bad one is reported alone."""
    return Field(min_length=least, max_length=most, fail_fast=True)


def first_message(error: ValidationError) -> str:
    """One line for the first problem of a pydantic error: the field's path and what is wrong there."""
    return in_words(error.errors(include_url=False, include_input=False)[0])


def in_words(problem: ErrorDetails) -> str:
    """One line for one problem: the field's path and what is wrong there."""
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part:.80}" for part in problem["loc"])
    path = " ".join(path.removeprefix(".").split())
    message = problem["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    if problem["type"] in PLAIN_WORDS:
        message = PLAIN_WORDS[problem["type"]].format_map(problem.get("ctx", {}))
    return f"{path}: {message}" if path else message


def write_atomically(path: Path, text: str) -> None:
    """Replace `path` by `text` in one step that survives a crash. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
