"""Why a training does not begin or go on, and why weights are not used."""

from __future__ import annotations

import math


class PolicyError(ValueError):
    """Weights that cannot be used; the message says which file and why."""


class TrainingRefusal(ValueError):
    """A training that was asked for wrongly: where, and what would be right."""


class TrainingError(RuntimeError):
    """A training that cannot go on; what was finished is kept, and the message says so."""


def check_finite(losses: dict[str, float], after: str) -> None:
    """Raises TrainingError, naming the first that is no number; `after`: what was finished before."""
    for name, loss in losses.items():
        if not math.isfinite(loss):
            raise TrainingError(f"the loss {name!r} is {loss} after {after}; the best weights are kept")
