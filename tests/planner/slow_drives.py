"""Drives that take a moment and touch a file when they begin."""

import os
import time
from pathlib import Path

from drives import mission


def attempt(marks: Path, spec):
    (marks / f"{spec.seed}-{os.environ.get('COVERNAV_TEST_NODE', '')}-{os.getpid()}").touch()
    time.sleep(1.0)
    return mission(spec.seed, exposed_s=0.5 * spec.seed)
