"""How likely a watcher is to notice what it sees: a hazard rate that grows with what shows of the robot and
falls with the distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scenes.scenario import ObserverSpec


@dataclass(frozen=True)
class DetectionModel:
    """Noticing as a Poisson process: an observer who sees the fraction f of the robot at a distance of d
    metres notices it at the rate  rate · f · exp(-(d / distance)²)  a second. Observers watch independently,
    so that their rates add up, and the probability of detection is 1 - exp(-∫ rates dt).

    With the defaults a Husky in the open is noticed at 10 m within 1.3 s on average and within 6 s with
    99 %, at 20 m within 2.7 s, at 40 m within 55 s.

    rate : a second, at point-blank range in plain view; distance : metres at which it has fallen to 1/e
    Raises ValueError for a rate below 0, a distance not above 0, or either not finite.
    """

    rate: float = 1.0
    distance: float = 20.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate) and self.rate >= 0.0):
            raise ValueError(f"the rate of detection must be 0 or more a second, got {self.rate}")
        if not (math.isfinite(self.distance) and self.distance > 0.0):
            raise ValueError(f"the distance of detection must be more than 0 m, got {self.distance}")

    def hazard(self, fraction: np.ndarray | float, distance: np.ndarray | float) -> np.ndarray:
        """Rate a second of each observer, for visible fractions from 0 to 1 and distances in metres, arrays
        that broadcast."""
        return self.rate * np.asarray(fraction) * np.exp(-np.square(np.asarray(distance) / self.distance))


def detection_of(observer: ObserverSpec) -> DetectionModel:
    """As the observer's own properties have it."""
    return DetectionModel(observer.detection_rate, observer.detection_distance)


def probability(hazard: float) -> float:
    """Of at least one detection, for a hazard integrated over time."""
    return -math.expm1(-hazard)
