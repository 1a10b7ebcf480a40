"""Real drives that leave a mark when they begin, and go on only once they are let go."""

import os
import time
from pathlib import Path

from planner.evaluation_run import attempt_here

LET_GO = "let-go"


def attempt(marks: Path, spec):
    (marks / f"{spec.seed}-{os.getpid()}-{time.monotonic_ns()}").touch()
    end = time.monotonic() + 120.0
    while not (marks / LET_GO).exists() and time.monotonic() < end:
        time.sleep(0.05)
    return attempt_here(spec)
