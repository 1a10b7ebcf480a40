"""Drives that take their process with them."""

import os
import signal
from pathlib import Path

from drives import mission

DEADLY, ONCE = 1, 2


def attempt(marks: Path, spec):
    """Seed 1 kills its process every time, seed 2 the first time; each time leaves a mark."""
    times = len(list(marks.glob(f"{spec.seed}-*")))
    (marks / f"{spec.seed}-{times}").touch()
    if spec.seed == DEADLY or (spec.seed == ONCE and times == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return mission(spec.seed)
