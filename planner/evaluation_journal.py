"""Finished missions, kept as JSON lines: a line is there whole or not at all, whatever happens."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from pathlib import Path
from typing import Any

from planner.evaluation import ERROR, MissionSpec

NAME = "missions.jsonl"
RESERVE = ".reserve"
RESERVE_BYTES = 2**20
FULL = (errno.ENOSPC, errno.EDQUOT)
BEGINNING = b'{"terrain": '
"""Of every line that we write."""


class JournalError(ValueError):
    """A folder or journal that cannot be gone on with, in one sentence."""


class Journal:
    """The missions in a folder, for one evaluation at a time.

    damaged : how many lines are no missions among others that are; they stay where they are, and what they
        held is driven again

    On a full disk the room that was set aside beside it takes the missions that are under way; `full` then
    says that no more should be begun.

    Raises JournalError for a folder that holds something else, a damaged journal or one that another process
    writes; OSError where nothing can be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / NAME
        self.full = False
        folder.mkdir(parents=True, exist_ok=True)
        if not self.path.exists() and any(entry.name != RESERVE for entry in folder.iterdir()):
            raise JournalError(
                f"{folder} is not empty and holds no evaluation ({NAME} is missing);"
                " name a new or empty folder"
            )
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            self._lock()
            found, bad = _read(self.path)
            self.results = {MissionSpec.of(result): result for result in found}
            self.damaged = len(bad)
            self._mend_loose_end()
            self._set_aside()
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back the reserve; safe to call twice."""
        if self._file >= 0:
            (self.folder / RESERVE).unlink(missing_ok=True)
            os.close(self._file)
            self._file = -1

    def add(self, result: dict[str, Any]) -> None:
        """Keep a result for good. Raises OSError where there is no room even with the reserve's."""
        line = (json.dumps(result, allow_nan=False) + "\n").encode()
        try:
            self._append(line)
        except OSError as error:
            if error.errno not in FULL or self.full:
                raise
            self.full = True
            (self.folder / RESERVE).unlink(missing_ok=True)
            self._append(line)
        self.results[MissionSpec.of(result)] = result

    def _append(self, line: bytes) -> None:
        size = os.fstat(self._file).st_size
        try:
            rest = line
            while rest:
                rest = rest[os.write(self._file, rest) :]
            os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, size)
            raise

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise JournalError(f"another evaluation is writing into {self.folder}; wait for it") from None

    def _mend_loose_end(self) -> None:
        """A line that was cut off in the middle goes: that mission is driven again."""
        text = self.path.read_bytes()
        begun = text.rfind(b"\n") + 1
        loose = text[begun:]
        if _result(loose) is not None or not _cut_off(loose):
            self._append(b"\n")
        else:
            os.ftruncate(self._file, begun)

    def _set_aside(self) -> None:
        handle = os.open(self.folder / RESERVE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            os.write(handle, bytes(RESERVE_BYTES))
            os.fsync(handle)
        finally:
            os.close(handle)


def _read(path: Path) -> tuple[list[dict[str, Any]], list[int]]:
    """The journal's missions, the last word on each, and the numbers of the lines that are damaged. Missions
    that ended in an error are left out, for they are to be driven again. What a mission's line that was cut
    off at the end has left does not count, nor do damaged lines among others that are whole.

    Raises JournalError, OSError."""
    found: dict[MissionSpec, dict[str, Any]] = {}
    bad: list[int] = []
    *whole, loose = path.read_bytes().split(b"\n")
    for number, line in enumerate([*whole, loose], 1):
        result = _result(line)
        if result is not None:
            found[MissionSpec.of(result)] = result
            continue
        if number <= len(whole) or not _cut_off(line):
            bad.append(number)
    if loose and not loose.strip(b"\0") and not found:
        bad.append(len(whole) + 1)  # nothing but zeros is no journal of ours
    if bad and not found:
        raise JournalError(f"{path}, line {bad[0]}: not a finished mission; move the file away")
    return [result for result in found.values() if result["status"] != ERROR], bad


def _cut_off(line: bytes) -> bool:
    """Whether that may have been the beginning of a mission's line."""
    begun = line.rstrip(b"\0")  # which some file systems leave behind when the power fails
    return begun.startswith(BEGINNING) or BEGINNING.startswith(begun)


def _result(line: bytes) -> dict[str, Any] | None:
    """What a line says, None where that is no mission."""
    try:
        result = json.loads(line)
        MissionSpec.of(result)
        return result | {"status": str(result["status"])}
    except (ValueError, KeyError, TypeError):
        return None
