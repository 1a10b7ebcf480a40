"""How the bench measures: both sides in one run, turn by turn, by the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Result:
    """One comparison.

    ours, peer : in `unit`; ratio : how many times better ours is
    identical : how the equality of the results was checked, and how it came out
    """

    name: str
    ours: float
    peer: float
    peer_name: str
    ratio: float
    unit: str
    identical: str


def faster(name: str, ours: float, peer: float, peer_name: str, identical: str, unit: str = "ms") -> Result:
    """A result whose numbers are times: less is better."""
    return Result(name, round(ours, 4), round(peer, 4), peer_name, round(peer / ours, 2), unit, identical)


def interleaved(
    ours: Callable[[], object], peer: Callable[[], object], repeats: int, ours_per_turn: int = 1
) -> tuple[float, float]:
    """Median milliseconds of each side, measured in turns after one untimed call of both."""
    ours()
    peer()
    ours_ms, peer_ms = [], []
    for _ in range(repeats):
        ours_ms += [milliseconds(ours) for _ in range(ours_per_turn)]
        peer_ms.append(milliseconds(peer))
    return float(np.median(ours_ms)), float(np.median(peer_ms))


def milliseconds(call: Callable[[], object]) -> float:
    begun = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - begun)


def percentile(values: Sequence[float], share: float) -> float:
    return float(np.percentile(np.asarray(values, float), share))
