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
    path = folder = Path(target)
    try:
        if path.is_dir():
            raise refusal(f"{target} cannot be written: it is a folder")
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise refusal(f"{target:.200} cannot be written: {folder}: {error.strerror or error}") from None


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


LEARNER = "learner"
"""A file in the folder of a training, which says whose it is."""


@contextmanager
def learning_in(folder: Path, learner: str) -> Iterator[None]:
    """Make the folder that a training is to fill, and hold it. Raises TrainingRefusal where that cannot be,
    where it holds something else and while another trains in it; TrainingError where it cannot be written
    later on."""
    from planner.folder_lock import NAME, FolderInUse, FolderLock
    from planner.learning_errors import TrainingError, TrainingRefusal

    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / NAME).exists():  # what is refused is left as it was
            _check_held(folder, learner)
        lock = FolderLock(folder)
    except FolderInUse as error:
        words = f"process {error.holder} trains in {folder} already; choose another"
        raise TrainingRefusal(words) from None
    except OSError as error:
        raise TrainingRefusal(f"{folder} cannot be written: {error.strerror or error}") from None
    try:
        _check_held(folder, learner)
        (folder / LEARNER).write_text(f"{learner}\n", "utf-8")
        yield
    except OSError as error:
        words = f"{folder} cannot be written: {error.strerror or error}"
        raise TrainingError(f"{words}; what was finished in it is kept") from None
    finally:
        lock.close()


def _check_held(folder: Path, learner: str) -> None:
    from planner.learning_errors import TrainingRefusal

    mark = folder / LEARNER
    if mark.is_file() and mark.read_text("utf-8", "replace").strip() != learner:
        raise TrainingRefusal(f"{folder} holds a training of another learner; name another with --out")
    if not mark.is_file() and (strange := held(folder)):
        raise TrainingRefusal(f"{folder} is not empty (it has {strange[0]!r}); name another with --out")


def held(folder: Path) -> list[str]:
    """What is in a training's folder besides the marks of `learning_in`."""
    from planner.folder_lock import NAME

    return sorted(entry.name for entry in folder.iterdir() if entry.name not in (NAME, LEARNER))
