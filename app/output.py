"""Where commands put what they have found: a file, or - for standard output."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def check_target(target: str | None, refusal: type[Exception]) -> None:
    """Raises `refusal` where nothing can be written there, before hours have gone into what would be."""
    if target is None or target == "-":
        return
    path = Path(target)
    if path.is_dir():
        raise refusal(f"{target} cannot be written: it is a folder")
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise refusal(f"{target} cannot be written: {folder}: {error.strerror or error}") from None


def write_text(target: str, text: str, refusal: type[Exception]) -> None:
    """Write text whole or not at all. Raises `refusal`, in words, where the file cannot be written."""
    from scenes.scenario import write_atomically  # only once there is something to write

    if target == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    try:
        write_atomically(Path(target), text)
    except OSError as error:
        raise refusal(f"{target} cannot be written: {error.strerror or error}") from None


def write_json(target: str, document: Any, refusal: type[Exception]) -> None:
    """As `write_text`, a document. Raises ValueError for numbers that JSON does not have."""
    write_text(target, json.dumps(document, indent=1, allow_nan=False) + "\n", refusal)


@contextmanager
def learning_in(folder: Path) -> Iterator[None]:
    """Make the folder that a training is to fill. Raises TrainingRefusal where it cannot be, TrainingError
    where it cannot be written later on."""
    from planner.learning_errors import TrainingError, TrainingRefusal

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrainingRefusal(f"{folder} cannot be written: {error.strerror or error}") from None
    try:
        yield
    except OSError as error:
        words = f"{folder} cannot be written: {error.strerror or error}"
        raise TrainingError(f"{words}; what was finished in it is kept") from None
