"""Which code drove: a short hash, so that drives of different code are told apart."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

PACKAGES = ("planner", "scenes")


@cache
def code_digest() -> str:
    """Twelve hexadecimal digits of the sources of what a drive depends on, the same in every installation."""
    root = Path(__file__).parents[1]
    found = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:12]
