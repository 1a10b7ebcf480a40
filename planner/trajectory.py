"""Where a drive went, kept small: twice a second, in whole centimetres, degrees and per cent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.frames import Frame

PERIOD_S = 0.5
FARTHEST = 1e9  # of any number in a document


class TrajectoryLog:
    """Takes a drive's frames as they come and gives its document."""

    def __init__(self) -> None:
        self._kept: list[tuple[int, int, int, int]] = []
        self._last: Frame | None = None
        self._begun_s = 0.0

    def add(self, frame: Frame) -> None:
        if self._last is None:
            self._begun_s = frame.time_s
        self._last = frame
        if frame.time_s - self._begun_s >= PERIOD_S * len(self._kept) - 1e-6:
            self._kept.append(_sample(frame))

    def document(self) -> dict[str, Any]:
        """`period_s`, `end_s`, and one number a sample of `x_cm`, `y_cm`, `yaw_deg`, and `seen_pct`, the
        visible fraction; the last sample is of the end, all others of the multiples of the period."""
        samples, end_s = list(self._kept), 0.0
        if self._last is not None:
            end_s = round(self._last.time_s - self._begun_s, 3)
            if end_s > PERIOD_S * (len(samples) - 1) + 1e-6:
                samples.append(_sample(self._last))
        x, y, yaw, seen = (list(column) for column in zip(*samples, strict=True)) if samples else [[]] * 4
        return {"period_s": PERIOD_S, "end_s": end_s, "x_cm": x, "y_cm": y, "yaw_deg": yaw, "seen_pct": seen}


def _sample(frame: Frame) -> tuple[int, int, int, int]:
    pose = frame.pose
    return (
        round(100.0 * pose.x),
        round(100.0 * pose.y),
        round(math.degrees(pose.yaw)),
        round(100.0 * frame.exposure.fraction),
    )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A drive as it was kept.

    time_s, x, y : (n,) seconds from its beginning, metres; yaw : (n,) radians without jumps
    seen : (n,) visible fraction
    """

    time_s: np.ndarray
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    seen: np.ndarray

    @classmethod
    def of(cls, document: dict[str, Any]) -> Trajectory:
        """Raises ValueError for what is not a trajectory's document."""
        try:
            columns = [np.asarray(document[key], float) for key in ("x_cm", "y_cm", "yaw_deg", "seen_pct")]
            count, period, end_s = len(columns[0]), float(document["period_s"]), float(document["end_s"])
            if count == 0 or any(column.shape != (count,) for column in columns):
                raise ValueError
            if any(not np.all(np.abs(numbers) <= FARTHEST) for numbers in (*columns, period, end_s)):
                raise ValueError
        except (KeyError, TypeError, ValueError, OverflowError):
            raise ValueError(
                "not a trajectory: columns are missing, differ in length or hold what is no number"
            ) from None
        time_s = np.minimum(period * np.arange(count), end_s)
        x, y, yaw, seen = columns
        return cls(time_s, 0.01 * x, 0.01 * y, np.unwrap(np.radians(yaw)), 0.01 * seen)

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1])

    def at(self, time_s: float) -> tuple[float, float, float]:
        """x, y and yaw at a time; before its beginning and after its end the robot stands."""
        x, y, yaw = (float(np.interp(time_s, self.time_s, values)) for values in (self.x, self.y, self.yaw))
        return x, y, yaw
