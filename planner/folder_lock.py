"""One process at a time in a folder: a lock that the system gives back whatever becomes of its holder."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

NAME = "lock"


class FolderInUse(Exception):
    """Another process holds the folder; `holder` is its number, or words where that is not known."""

    def __init__(self, holder: str) -> None:
        super().__init__(holder)
        self.holder = holder


class FolderLock:
    """Holds a folder from when it is made until `close`. Raises FolderInUse; OSError, too where the folder
    has a file of that name which somebody else put there, and leaves it as it is."""

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder / NAME, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self._file, 32, 0).decode(errors="replace").strip() or "another process"
            self.close()
            raise FolderInUse(holder) from None
        found = os.pread(self._file, 32, 0)
        if found and not found.isdigit():
            self.close()
            raise OSError(errno.EEXIST, f"its file {NAME!r} is not one of the studio's; move it away")
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, str(os.getpid()).encode(), 0)

    def close(self) -> None:
        """Let others in; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
