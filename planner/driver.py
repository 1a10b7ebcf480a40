"""Driving to a point with the dynamic window, and getting free again where it finds no way on.

States: DRIVE toward the target; when no arc is admissible or nothing moves for a while BACK_OFF along the
path just driven, TURN on the spot toward the freest direction, LEAVE that way for a stretch, and DRIVE again.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

import numpy as np

from planner.driver_config import DriverConfig, approach
from planner.dwa import (
    NO_SLIP,
    DwaConfig,
    Ground,
    Rollout,
    Slip,
    Surroundings,
    Weights,
    candidates,
    evaluate,
    window,
)
from planner.frames import Arcs, Percept
from planner.motion import Motion, WeighedMotion
from planner.slip import SlipEstimate
from planner.way_out import corridors, crowded, evasive_arc, main_reason
from scenes.pose import Pose, Twist, wrap_angle

TRAIL_SPACING = 0.1


class State(StrEnum):
    DRIVE = "driving"
    BACK_OFF = "backing off"
    TURN = "turning"
    LEAVE = "leaving"


@dataclass(frozen=True)
class Driven:
    """One tick's command, the arcs it was chosen from, and why in words; `stuck` when it gives up."""

    command: Twist
    arcs: Arcs | None
    note: str
    stuck: bool = False


@dataclass(frozen=True)
class _Mark:
    time_s: float
    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, percept: Percept) -> _Mark:
        return cls(percept.time_s, percept.pose.x, percept.pose.y, percept.pose.yaw)

    def distance(self, percept: Percept) -> float:
        return math.hypot(percept.pose.x - self.x, percept.pose.y - self.y)


class Stopping(Protocol):
    """Knows how far the robot rolls on once it is told to stop."""

    def ways(self, pose: Pose, twist: Twist) -> np.ndarray:
        """(n,) metres along its heading, of stops as they go and as they go at worst."""
        ...


class Driver:
    """Keeps the recovery's state from tick to tick; `reset` forgets it.

    motion : what chooses the arc while driving to the target; recoveries are the dynamic window's own
    stopping : lets it drive on at full speed until the robot, told to stop, comes to rest at the goal;
        without, it slows down by the configured deceleration
    """

    def __init__(
        self,
        config: DriverConfig | None = None,
        motion: Motion | None = None,
        stopping: Stopping | None = None,
    ):
        self.config = config or DriverConfig()
        self.motion = motion or WeighedMotion()
        self.stopping = stopping
        self.reset()

    def reset(self) -> None:
        """Forget everything, as for a new goal."""
        self.motion.reset()
        self.state = State.DRIVE
        self._reason = ""
        self._entered: _Mark | None = None
        self._progress: _Mark | None = None
        self._blocked_since: float | None = None
        self._trail: deque[tuple[float, float]] = deque(maxlen=60)
        self._direction = 0.0
        self._slip = SlipEstimate()
        self._tried: list[float] = []
        self._trouble: _Mark | None = None
        self._narrow: _Mark | None = None
        self._recoveries = 0

    @property
    def recoveries(self) -> int:
        """How often it had to get free in this region."""
        return self._recoveries

    def drive(self, percept: Percept, target: tuple[float, float], ground: Ground) -> Driven:
        """The command toward `target` (world), slowing down as the percept's goal comes near."""
        self._remember(percept)
        self._slip.see(percept.pose)
        self.motion.see(percept)
        around = Surroundings(percept.obstacle_points, percept.moving, ground)
        if self._recoveries > self.config.recoveries:
            return Driven(Twist(), None, "stuck: no way on after many attempts", stuck=True)
        match self.state:
            case State.BACK_OFF:
                return self._back_off(percept, around)
            case State.TURN:
                return self._turn(percept, target, around)
            case State.LEAVE:
                return self._leave(percept, around)
        return self._drive(percept, target, around)

    # --- driving ---------------------------------------------------------------------------------

    def _drive(self, percept: Percept, target: tuple[float, float], around: Surroundings) -> Driven:
        if percept.goal_distance <= self.config.goal_tolerance:
            self._progress = _Mark.of(percept)
            return Driven(Twist(), None, "at the goal")
        if self._comes_to_rest(percept):
            self._progress = _Mark.of(percept)
            return Driven(Twist(), None, "stopping at the goal")
        rollout = self._arcs(percept, target, around, self.motion)
        if rollout.arcs.chosen >= 0:
            self._blocked_since = None
            self._take_heart(percept)
            if self._moves_on(percept):
                return Driven(_command(rollout.arcs), rollout.arcs, self._words(percept))
            return self._recover(percept, target, around, "no progress")
        if self._blocked_since is None:
            self._blocked_since = percept.time_s
        reason = main_reason(rollout.arcs)
        evasion = evasive_arc(rollout, percept.moving, self.config.dwa.dt)
        if evasion >= 0:
            arcs = replace(rollout.arcs, chosen=evasion)
            return Driven(_command(arcs), arcs, "giving way to something that moves")
        if percept.time_s - self._blocked_since < self.config.blocked_patience:
            return Driven(Twist(), rollout.arcs, f"stopping: {reason}")
        return self._recover(percept, target, around, reason)

    def _comes_to_rest(self, percept: Percept) -> bool:
        """Whether the robot would stand at the goal if it were told to stop now."""
        if self.stopping is None or percept.twist.v <= 0.0 or percept.goal_distance > self._stopping_range:
            return False
        ways = self.stopping.ways(percept.pose, percept.twist)
        ends = [_ahead(percept, percept.pose.yaw, float(way)) for way in ways]
        return max(math.dist(end, percept.goal) for end in ends) <= self.config.goal_tolerance

    @property
    def _stopping_range(self) -> float:
        """Metres from the goal within which a stop can matter."""
        dwa = self.config.dwa
        return 2.0 * self.config.goal_tolerance + dwa.max_speed**2 / dwa.braking

    @property
    def _squeezes(self) -> bool:
        return self._recoveries > self.config.patient_recoveries

    @property
    def _dwa(self) -> DwaConfig:
        dwa = self.config.dwa
        if self._squeezes:
            dwa = replace(dwa, leaving=self.config.squeezing)
        if self._narrow is not None:
            dwa = replace(dwa, weights=replace(dwa.weights, clearance=0.0))
        return dwa

    @property
    def _expected_slip(self) -> Slip:
        return NO_SLIP if self._squeezes else self._slip.slip

    def _arcs(
        self, percept: Percept, target: tuple[float, float], around: Surroundings, motion: Motion
    ) -> Rollout:
        config = self.config
        if self.stopping is not None and percept.goal_distance <= self._stopping_range:
            config = replace(config, shortest_horizon=config.late_horizon, slowest=config.dwa.max_speed)
        dwa, max_speed = approach(config, self._dwa, percept.pose, target, percept.goal_distance)
        rollout = motion.arcs(dwa, percept, target, around, max_speed, self._expected_slip)
        if rollout.arcs.chosen < 0 and crowded(rollout):
            dwa = replace(dwa, moving_margin=self.config.close_margin)
            closer = motion.arcs(dwa, percept, target, around, max_speed, self._expected_slip)
            return closer if closer.arcs.chosen >= 0 else rollout
        return rollout

    def _words(self, percept: Percept) -> str:
        return f"driving to the goal, {percept.goal_distance:.1f} m left"

    def _remember(self, percept: Percept) -> None:
        here = (percept.pose.x, percept.pose.y)
        if self.state is not State.BACK_OFF and (
            not self._trail or math.dist(self._trail[-1], here) >= TRAIL_SPACING
        ):
            self._trail.append(here)
        if self._progress is None:
            self._progress = _Mark.of(percept)
        if self._trouble is not None and self._trouble.distance(percept) > self.config.region:
            self._trouble, self._recoveries, self._tried = None, 0, []

    def _moves_on(self, percept: Percept) -> bool:
        mark = self._progress
        if mark is None or mark.distance(percept) >= self.config.progress:
            self._progress = _Mark.of(percept)
            return True
        return percept.time_s - mark.time_s < self.config.patience

    def _take_heart(self, percept: Percept) -> None:
        if self._narrow is not None:
            if self._narrow.distance(percept) > self.config.emboldened:
                self._narrow = None
        elif self._progress is not None and percept.time_s - self._progress.time_s >= self.config.boldness:
            self._narrow = _Mark.of(percept)

    # --- recovery --------------------------------------------------------------------------------

    def _recover(
        self, percept: Percept, target: tuple[float, float], around: Surroundings, reason: str
    ) -> Driven:
        self._recoveries += 1
        self._trouble = self._trouble or _Mark.of(percept)
        self._reason = reason
        self._enter(State.BACK_OFF if self._recoveries % 2 else State.TURN, percept)
        self._direction = self._freest(percept, target)
        if self.state is State.BACK_OFF:
            return self._back_off(percept, around)
        return self._turn(percept, target, around)

    def _enter(self, state: State, percept: Percept) -> None:
        self.state = state
        self._entered = self._progress = _Mark.of(percept)
        self._blocked_since = None

    def _spent(self, percept: Percept) -> bool:
        return self._entered is None or percept.time_s - self._entered.time_s > self.config.recovery_limit

    def _freest(self, percept: Percept, target: tuple[float, float]) -> float:
        """World bearing along which it could go far, not far from the target's, and not tried before."""
        bearings = 2.0 * np.pi * np.arange(48) / 48.0
        contact = 0.5 * self.config.dwa.footprint.width + self.config.dwa.contact_distance
        free = corridors(percept, bearings, contact, self.config.corridor)
        pose = percept.pose
        aside = np.abs(wrap_angle(bearings - math.atan2(target[1] - pose.y, target[0] - pose.x)))
        score = free - 0.15 * self.config.corridor * aside
        for tried in self._tried:
            score -= 1.5 * np.exp(-((wrap_angle(bearings - tried) / 0.5) ** 2))
        best = float(bearings[int(np.argmax(score))])
        self._tried.append(best)
        return best

    def _back_off(self, percept: Percept, around: Surroundings) -> Driven:
        entered = self._entered
        done = entered is None or entered.distance(percept) >= self.config.backing
        while self._trail and math.dist(self._trail[-1], (percept.pose.x, percept.pose.y)) < 0.4:
            self._trail.pop()
        if not done and not self._spent(percept):
            v, w = candidates(self.config.dwa, percept.twist)
            back = v < 0.0
            behind = self._trail[-1] if self._trail else _ahead(percept, percept.pose.yaw, -1.0)
            weights = Weights(heading=0.0, velocity=0.5)
            dwa = replace(self._dwa, weights=weights)
            if back.any():
                rollout = evaluate(
                    dwa, v[back], w[back], percept.pose, behind, around, dwa.min_speed, self._expected_slip
                )
                if rollout.arcs.chosen >= 0:
                    note = f"backing off: {self._reason}"
                    return Driven(_command(rollout.arcs), rollout.arcs, note)
            else:  # still rolling forward
                return Driven(Twist(), None, f"stopping: {self._reason}")
        self._enter(State.TURN, percept)
        return Driven(Twist(), None, f"turning to a free direction: {self._reason}")

    def _turn(self, percept: Percept, target: tuple[float, float], around: Surroundings) -> Driven:
        error = float(wrap_angle(self._direction - percept.pose.yaw))
        if abs(error) > 0.25 and not self._spent(percept):
            rate = math.copysign(min(1.0, 0.3 + abs(error)), error)
            _, _, slowest, fastest = window(self.config.dwa, percept.twist)
            for w in (min(max(wanted, slowest), fastest) for wanted in (rate, -rate)):
                rollout = evaluate(
                    replace(self._dwa, horizon=1.0),
                    np.zeros(1), np.array([w]), percept.pose, target, around, slip=self._expected_slip,
                )  # fmt: skip
                if rollout.arcs.chosen >= 0:
                    note = f"turning to a free direction: {self._reason}"
                    return Driven(Twist(0.0, w), rollout.arcs, note)
        self._enter(State.LEAVE, percept)
        return self._leave(percept, around)

    def _leave(self, percept: Percept, around: Surroundings) -> Driven:
        entered = self._entered
        gone = 0.0 if entered is None else entered.distance(percept)
        if gone < self.config.leaving and not self._spent(percept) and self._moves_on(percept):
            ahead = _ahead(percept, self._direction, 1.5)
            rollout = self._arcs(percept, ahead, around, WeighedMotion())
            if rollout.arcs.chosen >= 0:
                return Driven(_command(rollout.arcs), rollout.arcs, f"leaving a dead end: {self._reason}")
        self._enter(State.DRIVE, percept)
        return Driven(Twist(), None, self._words(percept))


def _command(arcs: Arcs) -> Twist:
    return Twist(float(arcs.v[arcs.chosen]), float(arcs.w[arcs.chosen]))


def _ahead(percept: Percept, bearing: float, distance: float) -> tuple[float, float]:
    pose = percept.pose
    return pose.x + distance * math.cos(bearing), pose.y + distance * math.sin(bearing)
