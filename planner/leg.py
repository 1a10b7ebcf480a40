"""One drive from where the robot was given its goal until it is over: its totals, and the summary of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planner.cover import detect_cover
from planner.dwa import DwaConfig, window
from planner.exposure_log import ExposureLog
from planner.frames import Metrics, Percept, Perception, Status
from scenes.catalogue import CATALOGUE
from scenes.pose import Pose, Twist

LIMITS = DwaConfig()
SLACK = 1e-6
"""The Husky's limits, and by how much a command may seem to break them for the rounding of numbers."""

BASE_TIME_LIMIT_S, TIME_LIMIT_PER_METRE = 30.0, 6.0


def usual_time_limit(distance: float) -> float:
    """Seconds that a drive of so many metres, straight, may take."""
    return BASE_TIME_LIMIT_S + TIME_LIMIT_PER_METRE * distance


def in_cover(percept: Percept) -> bool:
    """Algorithm 1 on what the robot knows: the newest image's detections, or all cover in oracle mode."""
    robot = (percept.pose.x, percept.pose.y, percept.pose.z)
    if percept.perception is Perception.ORACLE:
        names = [CATALOGUE[cover.kind].class_name for cover in percept.cover]
        places = [(cover.x, cover.y, cover.z) for cover in percept.cover]
        return detect_cover(names, places, robot, [cover.confidence for cover in percept.cover])
    found = percept.detections
    places = [(detection.x_pos, detection.y_pos, detection.z_pos) for detection in found]
    return detect_cover(
        [detection.class_name for detection in found],
        places,
        robot,
        [detection.confidence for detection in found],
    )


@dataclass
class Leg:
    """Begun at `begun_s` from `start` (true pose in the world) for `goal`; `time_limit_s` from then on."""

    begun_s: float
    start: Pose
    goal: tuple[float, float]
    time_limit_s: float
    metrics: Metrics = field(default_factory=Metrics)
    exposure: ExposureLog = field(default_factory=ExposureLog)
    planner_ms: list[float] = field(default_factory=list)
    dynamic_violations: int = 0
    _last: Pose | None = None
    _ticks_in_cover: int = 0

    @property
    def straight_line_m(self) -> float:
        return math.hypot(self.goal[0] - self.start.x, self.goal[1] - self.start.y)

    def command(self, command: Twist, twist: Twist) -> None:
        """Count a command that the robot, moving with `twist`, cannot reach within a control period. To stand
        still is none: it asks for the hardest braking that there is."""
        v_low, v_high, w_low, w_high = window(LIMITS, twist)
        reachable = (
            v_low - SLACK <= command.v <= v_high + SLACK and w_low - SLACK <= command.w <= w_high + SLACK
        )
        self.dynamic_violations += not (reachable or command == Twist())

    def add(self, pose: Pose, covered: bool, collisions: int, planner_ms: float) -> None:
        """Count one tick: the true pose after it, Algorithm 1's answer, new contacts, planning time."""
        last = self._last or self.start
        self._last = pose
        self.planner_ms.append(planner_ms)
        self._ticks_in_cover += covered
        old = self.metrics
        self.metrics = replace(
            old,
            trajectory_length_m=old.trajectory_length_m + math.hypot(pose.x - last.x, pose.y - last.y),
            collisions=old.collisions + collisions,
            max_roll=max(old.max_roll, abs(pose.roll)),
            max_pitch=max(old.max_pitch, abs(pose.pitch)),
            cover_fraction=self._ticks_in_cover / len(self.planner_ms),
            elevation_gradient_m=old.elevation_gradient_m + abs(pose.z - last.z),
        )

    def summary(
        self, scenario: str, method: str, perception: Perception, seed: int, status: Status, time_s: float
    ) -> dict[str, Any]:
        """The document of `covernav run --json`; lengths in metres, angles in degrees."""
        times = self.planner_ms or [0.0]
        return {
            "scenario": scenario,
            "method": method,
            "perception": str(perception),
            "seed": seed,
            "status": str(status),
            "success": status is Status.REACHED,
            "trajectory_length_m": self.metrics.trajectory_length_m,
            "straight_line_m": self.straight_line_m,
            "execution_time_s": time_s - self.begun_s,
            **self.exposure.summary(),
            "cover_fraction": self.metrics.cover_fraction,
            "collisions": self.metrics.collisions,
            "max_roll_deg": math.degrees(self.metrics.max_roll),
            "max_pitch_deg": math.degrees(self.metrics.max_pitch),
            "planner_ms_p50": float(np.percentile(times, 50)),
            "planner_ms_p95": float(np.percentile(times, 95)),
            "policy": None,
            **self.exposure.details(),
            "elevation_gradient_m": self.metrics.elevation_gradient_m,
            "dynamic_violations": self.dynamic_violations,
        }
