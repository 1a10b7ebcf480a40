"""The exposure of a drive: how long, how far and how surely it was seen, by each observer and by all."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from planner.detection_model import probability
from planner.frames import Exposure, Frame, Watch
from planner.line_of_sight import View, VisibleFraction
from scenes.pose import Pose
from scenes.robot import HUSKY

NOTICEABLE = 0.05
"""Visible fraction above which the robot counts as seen without interruption, and below as concealed."""


@dataclass
class _Tally:
    """Running totals of a visible fraction; `hazard` is integrated over time."""

    fraction: float = 0.0
    exposed_s: float = 0.0
    longest_s: float = 0.0
    hazard: float = 0.0
    _unbroken_s: float = 0.0

    def add(self, seconds: float, fraction: float, hazard: float) -> None:
        self.fraction = fraction
        self.exposed_s += seconds * fraction
        self.hazard += seconds * hazard
        self._unbroken_s = self._unbroken_s + seconds if fraction > NOTICEABLE else 0.0
        self.longest_s = max(self.longest_s, self._unbroken_s)


@dataclass
class ExposureLog:
    """Totals of a drive, tick by tick; each tick counts with what is seen at its end."""

    duration_s: float = 0.0
    _united: _Tally = field(default_factory=_Tally)
    _each: dict[int, _Tally] = field(default_factory=dict)
    _concealed_s: float = 0.0
    _detected_s: float = 0.0  # moment of detection times its probability, summed

    def add(self, seconds: float, views: Sequence[View], seen: VisibleFraction, pose: Pose) -> None:
        """Count `seconds` in which the robot stood at `pose` and `seen` of it was in the views. None at all
        only take note of what is seen now."""
        middle = np.array([pose.x, pose.y, pose.z + 0.5 * HUSKY.height])
        eyes = np.array([view.eye for view in views]).reshape(-1, 3)
        distances = np.linalg.norm(eyes - middle, axis=1)
        hazards = [
            float(view.detection.hazard(fraction, distance))
            for view, fraction, distance in zip(views, seen.each, distances, strict=True)
        ]
        for tally in self._each.values():
            tally.fraction = 0.0
        for view, fraction, hazard in zip(views, seen.each.tolist(), hazards, strict=True):
            self._each.setdefault(view.observer_id, _Tally()).add(seconds, fraction, hazard)
        unseen = math.exp(-self._united.hazard)
        together = sum(hazards)
        self._united.add(seconds, seen.united, together)
        self._detected_s += (self.duration_s + 0.5 * seconds) * unseen * probability(seconds * together)
        self._concealed_s += seconds if seen.united <= NOTICEABLE else 0.0
        self.duration_s += seconds

    @property
    def exposure(self) -> Exposure:
        """What is seen now, and the totals so far."""
        duration, united = self.duration_s, self._united
        detection = probability(united.hazard)
        return Exposure(
            fraction=united.fraction,
            exposed_s=united.exposed_s,
            exposure_fraction=united.exposed_s / duration if duration else 0.0,
            longest_exposure_s=united.longest_s,
            concealed_fraction=self._concealed_s / duration if duration else 0.0,
            detection_probability=detection,
            expected_detection_s=self._detected_s / detection if detection else None,
            watches=tuple(
                Watch(
                    observer_id,
                    tally.fraction,
                    tally.exposed_s,
                    tally.exposed_s / duration if duration else 0.0,
                    tally.longest_s,
                    probability(tally.hazard),
                )
                for observer_id, tally in sorted(self._each.items())
            ),
        )

    def summary(self) -> dict[str, float]:
        """The exposure keys that `covernav run --json` began with."""
        now = self.exposure
        return {
            "exposure_fraction": now.exposure_fraction,
            "exposed_s": now.exposed_s,
            "longest_exposure_s": now.longest_exposure_s,
            "detection_probability": now.detection_probability,
        }

    def details(self) -> dict[str, Any]:
        """Its further keys; `by_observer` has the totals for each of them."""
        now = self.exposure
        return {
            "expected_detection_s": now.expected_detection_s,
            "concealed_fraction": now.concealed_fraction,
            "by_observer": [
                {name: value for name, value in asdict(watch).items() if name != "fraction"}
                for watch in now.watches
            ],
        }


def timeline(frames: Iterable[Frame]) -> dict[str, list[float]]:
    """A drive's exposure over time, a value a tick: the visible fraction and the probability of having been
    detected so far."""
    ticks = [(frame.time_s, frame.exposure) for frame in frames]
    return {
        "time_s": [round(time_s, 3) for time_s, _ in ticks],
        "exposure": [round(now.fraction, 4) for _, now in ticks],
        "detection_probability": [round(now.detection_probability, 6) for _, now in ticks],
    }
