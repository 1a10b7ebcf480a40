"""How fast the robot goes along a route: what turns metres into the seconds it can be seen for.

The figures are those at which `planner.driver` takes a Husky over generated terrain in full physics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenes.pose import Pose, wrap_angle

DETOUR = 1.25
"""How much longer than the straight line ways are, on the mean."""

SAMPLE_SPACING = 0.2
"""Metres between the places at which a route is looked at."""


@dataclass(frozen=True)
class Pace:
    """Metres, seconds, radians.

    cruise : m/s on open ground
    slow, narrow, wide : m/s where the middle is `narrow` metres from an obstacle; `cruise` from `wide` on
    deceleration, slowest : toward the goal, as `planner.driver` brakes; `arrived` from it the drive is over
    turn_rate : with which the robot turns to its route before it goes; `easy_turn` it takes while driving
    """

    cruise: float = 0.95
    slow: float = 0.2
    narrow: float = 0.5
    wide: float = 1.0
    deceleration: float = 0.5
    slowest: float = 0.25
    arrived: float = 0.25
    turn_rate: float = 1.0
    easy_turn: float = 0.4

    def speed(self, clearance: np.ndarray) -> np.ndarray:
        """m/s at places so many metres from the nearest obstacle."""
        share = np.clip((clearance - self.narrow) / (self.wide - self.narrow), 0.0, 1.0)
        return self.slow + share * (self.cruise - self.slow)

    def arriving(self, distance: np.ndarray) -> np.ndarray:
        """m/s that are not exceeded so many metres from the goal."""
        return np.clip(np.sqrt(2.0 * self.deceleration * distance), self.slowest, self.cruise)

    def turning(self, by: float) -> float:
        """Seconds to turn on the spot by an angle."""
        return max(0.0, abs(float(wrap_angle(by))) - self.easy_turn) / self.turn_rate


def seconds_to(pose: Pose, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """About how long a robot at a pose takes to places (...) in the world."""
    return DETOUR * np.hypot(x - pose.x, y - pose.y) / Pace.cruise


@dataclass(frozen=True, eq=False)
class Course:
    """Where the robot is along a route: n places with the seconds (n,) that it spends about each, which add
    up to the drive; positions (n, 2), yaw (n,)."""

    positions: np.ndarray
    yaw: np.ndarray
    seconds: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """(n,) seconds since the start at which each place is reached, in the middle of its share."""
        return np.cumsum(self.seconds) - 0.5 * self.seconds


def sample(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along a polyline (k, 2) about `SAMPLE_SPACING` apart: the middles (n, 2) of equal pieces of each
    segment, their yaw (n,) and length (n,)."""
    middles, yaws, lengths = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)]
    for begin, end in pairwise(points):
        length = float(math.dist(begin, end))
        if length <= 0.0:
            continue
        count = max(1, math.ceil(length / SAMPLE_SPACING))
        share = (np.arange(count) + 0.5) / count
        middles.append(begin + share[:, None] * (end - begin))
        yaws.append(np.full(count, math.atan2(*(end - begin)[::-1])))
        lengths.append(np.full(count, length / count))
    return np.concatenate(middles), np.concatenate(yaws), np.concatenate(lengths)


def course(points: np.ndarray, pace: Pace, clearance, yaw: float | None = None) -> Course:
    """The drive along a polyline (k, 2) to its last point.

    clearance : function from positions (n, 2) to metres (n,) from the nearest obstacle
    yaw : of the robot before it sets off; left out it need not turn
    """
    positions, yaws, lengths = sample(points)
    to_goal = np.hypot(*(positions - points[-1]).T)
    speed = np.minimum(pace.speed(clearance(positions)), pace.arriving(to_goal))
    left = np.cumsum(lengths[::-1])[::-1] - 0.5 * lengths
    seconds = np.where(left > pace.arrived, lengths / speed, 0.0)
    if yaw is None or not len(yaws):
        return Course(positions, yaws, seconds)
    turn = float(wrap_angle(yaws[0] - yaw))
    dwell = pace.turning(turn)
    steps = max(1, math.ceil(dwell / SAMPLE_SPACING)) if dwell > 0.0 else 0
    share = (np.arange(steps) + 0.5) / max(steps, 1)
    return Course(
        np.concatenate([np.tile(points[0], (steps, 1)), positions]),
        np.concatenate([yaw + share * turn, yaws]),
        np.concatenate([np.full(steps, dwell / max(steps, 1)), seconds]),
    )
