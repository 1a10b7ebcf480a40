"""95 % intervals of what an evaluation measures: rates, means, ratios, and paired differences of rates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

Z = 1.959964


def wilson(successes: int, trials: int, z: float = Z) -> tuple[float, float]:
    """Score interval of a rate (Wilson 1927)."""
    if trials == 0:
        return 0.0, 1.0
    rate = successes / trials
    scale = 1.0 + z * z / trials
    middle = (rate + z * z / (2.0 * trials)) / scale
    half = z / scale * math.sqrt(rate * (1.0 - rate) / trials + z * z / (4.0 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def student(values: Sequence[float]) -> tuple[float, float] | None:
    """Interval of the mean by Student's t; None for fewer than two values."""
    count = len(values)
    if count < 2:
        return None
    middle = float(np.mean(values))
    half = float(stdtrit(count - 1, 0.975)) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return middle - half, middle + half


def ratio(above: Sequence[float], below: Sequence[float], draws: int) -> tuple[float, float] | None:
    """Interval of sum(above) / sum(below) over the same cases, by the percentiles of so many bootstrap draws
    (Efron 1979), always the same ones; None for fewer than two cases, or where draws have nothing below."""
    cases = np.column_stack([above, below]).astype(float)
    if len(cases) < 2:
        return None
    picked = np.random.default_rng(0).integers(len(cases), size=(draws, len(cases)))
    sums = cases[picked].sum(axis=1)
    if (sums[:, 1] <= 0.0).any():
        return None
    low, high = np.percentile(sums[:, 0] / sums[:, 1], [2.5, 97.5])
    return float(low), float(high)


def paired_rates(both: int, first: int, second: int, neither: int) -> tuple[float, float]:
    """Interval of the difference of two rates over the same trials, the first's less the second's, with how
    often both succeeded, only the first, only the second, neither (Newcombe 1998, Statistics in Medicine 17,
    2635, method 10). Raises ValueError where there is no trial."""
    trials = both + first + second + neither
    if trials == 0:
        raise ValueError("there is nothing to compare: no mission was driven by both")
    product = (both + first) * (second + neither) * (both + second) * (first + neither)
    likeness = 0.0
    if product > 0:
        excess = both * neither - first * second
        if excess > 0:
            excess = max(excess - 0.5 * trials, 0.0)
        likeness = excess / math.sqrt(product)
    return square_and_add(
        (both + first) / trials,
        wilson(both + first, trials),
        (both + second) / trials,
        wilson(both + second, trials),
        likeness,
    )


def square_and_add(
    one: float,
    one_interval: tuple[float, float],
    other: float,
    other_interval: tuple[float, float],
    likeness: float = 0.0,
) -> tuple[float, float]:
    """Interval of `one - other` from an interval of each and their correlation."""
    below, above = one - one_interval[0], one_interval[1] - one
    other_below, other_above = other - other_interval[0], other_interval[1] - other
    low = math.sqrt(max(below**2 - 2.0 * likeness * below * other_above + other_above**2, 0.0))
    high = math.sqrt(max(above**2 - 2.0 * likeness * above * other_below + other_below**2, 0.0))
    return one - other - low, one - other + high
