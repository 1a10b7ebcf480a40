"""How the driver goes about it, and what it asks of the dynamic window on the way to a goal."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from planner.dwa import DwaConfig
from scenes.pose import Pose


@dataclass(frozen=True)
class DriverConfig:
    """Metres, seconds, radians.

    goal_tolerance : nearer to the goal the robot stops; the mission counts 0.3 m as reached
    deceleration : m/s² with which it slows down toward the goal; slowest : m/s it does not fall below before
    shortest_horizon : of the arcs when the target is near
    patience : without an admissible arc, or without `progress` metres or a good turn, before a recovery
    boldness : seconds without progress after which the clearance no longer counts among the admissible arcs,
        until the robot is `emboldened` metres away: in a narrow passage standing still is the clearest arc
    backing, leaving : how far a recovery drives back and away
    recovery_limit : longest that a part of it takes
    corridor : how far a free direction is looked along
    recoveries : in one region, after which the robot is stuck; region : its radius
    patient_recoveries : after so many it doubts the slip that it has learnt, and leaves what it is too near
        to by `squeezing` instead of by the dynamic window's own `leaving`: it would never get free where
        every arc ends a little nearer to something
    close_margin : kept to what moves where nothing keeps the dynamic window's own `moving_margin`
    late_horizon : shortest horizon of a driver that knows how far the robot rolls on
    """

    goal_tolerance: float = 0.2
    deceleration: float = 0.5
    slowest: float = 0.25
    shortest_horizon: float = 0.7
    blocked_patience: float = 0.8
    patience: float = 3.0
    progress: float = 0.3
    boldness: float = 1.0
    emboldened: float = 1.2
    backing: float = 0.7
    leaving: float = 1.5
    recovery_limit: float = 5.0
    corridor: float = 3.0
    region: float = 2.5
    recoveries: int = 10
    patient_recoveries: int = 2
    squeezing: tuple[float, float, float] = (0.02, 0.6, 0.01)
    close_margin: float = 0.05
    late_horizon: float = 0.3
    dwa: DwaConfig = field(default_factory=DwaConfig)


def approach(
    config: DriverConfig, dwa: DwaConfig, pose: Pose, target: tuple[float, float], goal_distance: float
) -> tuple[DwaConfig, float]:
    """The window's settings for a target (world) on the way to a goal so many metres off, and the speed m/s
    at which the robot may come near it."""
    slowing = math.sqrt(2.0 * config.deceleration * goal_distance)
    max_speed = float(np.clip(slowing, config.slowest, dwa.max_speed))
    # Arcs much longer than the way to the target would rather crawl than end beyond it.
    reach = math.dist(target, (pose.x, pose.y))
    horizon = float(np.clip(0.95 * reach / max_speed, config.shortest_horizon, dwa.horizon))
    # What stands beside the goal must not keep the robot from it.
    near = min(1.0, goal_distance / dwa.clearance_reach)
    weights = replace(dwa.weights, clearance=near * dwa.weights.clearance)
    return replace(dwa, horizon=horizon, weights=weights), max_speed
