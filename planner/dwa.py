"""The dynamic window approach: candidate velocities the robot can reach within a control period, each rolled
out as an arc, checked and weighed.

Fox, Burgard and Thrun 1997 (window, admissible means able to stop before contact); Seder and Petrović 2007
(moving obstacles extrapolated at constant velocity with the arc's own time samples).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from planner.dwa_kernel import roll_out, weigh
from planner.frames import Arcs, TrackedObstacle
from planner.tracking import outline_discs
from scenes.pose import Pose, Twist
from scenes.robot import HUSKY

_WHEELS = np.array(
    [
        (side_x * 0.5 * HUSKY.wheelbase, side_y * 0.5 * HUSKY.track)
        for side_x, side_y in ((1, 1), (1, -1), (-1, 1), (-1, -1))
    ]
)


@dataclass(frozen=True)
class Footprint:
    """All that is nearer than `radius` to a core rectangle about the base; metres. A core without size makes
    a round robot, no radius a rectangular one."""

    length: float
    width: float
    radius: float = 0.0


@dataclass(frozen=True)
class Weights:
    """What an arc is judged by; each weight times its term, lower is better.

    heading : per radian between the arc's end and the bearing of the target
    clearance : per 1/m of the least distance from the footprint's core to an obstacle point, less its value
        at `clearance_reach`
    velocity : per m/s short of the highest allowed speed
    goal : per metre between the arc's end and the target
    unknown, tilt : for an arc wholly on unknown ground; for one that tilts as far as the limits let it
    """

    heading: float = 0.3
    clearance: float = 0.3
    velocity: float = 0.25
    goal: float = 1.0
    unknown: float = 0.1
    tilt: float = 0.4


@dataclass(frozen=True)
class DwaConfig:
    """Limits in m/s, rad/s and their rates; times in seconds, distances in metres.

    control_period : over which the accelerations span the window
    horizon, dt : length and sampling of an arc
    heading_share : share of a step's turn taken before its translation (0.5: midpoint rule, 1: Euler)
    braking, yaw_braking, reaction : what the robot can surely stop with and how late it begins; no braking
        means that an arc must be free over its whole horizon
    creep_speed : at which unknown ground may be entered
    margin : kept between footprint and obstacles, `speed_margin` more for each m/s, less only where the robot
        is nearer already and leaves at no more than `escape_speed`
    leaving : how it leaves then, as `planner.dwa_kernel.roll_out` has it
    moving_margin : kept to moving obstacles; nearer than 0.9 m from its middle a VLP-16 sees nothing
    point_radius : how far from its mapped point an obstacle's surface may be, half the diagonal of a cell
    pitch_limit, roll_limit : radians, predicted from the map under the wheels; less roll than pitch, for a
        skid-steered robot that turns on a side slope slides down it
    clearance_reach : obstacles farther than this do not matter
    """

    max_speed: float = HUSKY.max_speed
    min_speed: float = -HUSKY.max_reverse_speed
    max_yaw_rate: float = HUSKY.max_yaw_rate
    acceleration: float = HUSKY.max_acceleration
    yaw_acceleration: float = HUSKY.max_yaw_acceleration
    control_period: float = 0.1
    speed_step: float = 0.1
    yaw_rate_step: float = 0.06
    horizon: float = 2.0
    dt: float = 0.1
    heading_share: float = 0.5
    braking: float = 1.5
    yaw_braking: float = 3.0
    reaction: float = 0.2
    creep_speed: float = 0.5
    margin: float = 0.07
    speed_margin: float = 0.12
    moving_margin: float = 0.3
    escape_speed: float = 0.3
    leaving: tuple[float, float, float] = (0.01, 0.8, 0.01)
    point_radius: float = 0.14
    pitch_limit: float = math.radians(25.0)
    roll_limit: float = math.radians(20.0)
    clearance_reach: float = 2.0
    footprint: Footprint = field(default_factory=lambda: Footprint(HUSKY.length, HUSKY.width))
    weights: Weights = field(default_factory=Weights)

    @property
    def contact_distance(self) -> float:
        """From the footprint's core to an obstacle point that counts as touched."""
        return self.footprint.radius + self.margin + self.point_radius

    @property
    def steps(self) -> int:
        return round(self.horizon / self.dt)


@dataclass(frozen=True)
class Ground:
    """The map under the arcs; world-aligned, cell [0, 0] centred at (x_min, y_min).

    elevation : (rows, cols) float, NaN where unknown
    forbidden : (rows, cols) bool, too steep or stepped to drive on
    """

    x_min: float
    y_min: float
    resolution: float
    elevation: np.ndarray
    forbidden: np.ndarray


NO_GROUND = Ground(0.0, 0.0, 1.0, np.zeros((0, 0)), np.zeros((0, 0), bool))


@dataclass(frozen=True)
class Slip:
    """Metres to the left that the robot slips for each radian it turns and for each metre it drives."""

    turning: float = 0.0
    driving: float = 0.0


NO_SLIP = Slip()


@dataclass(frozen=True)
class Surroundings:
    """All that an arc may run into.

    points : (m, 2) world points of mapped obstacles
    """

    points: np.ndarray
    moving: tuple[TrackedObstacle, ...] = ()
    ground: Ground = NO_GROUND


@dataclass(frozen=True)
class Rollout:
    """Arcs with the time (n,) in seconds each stays free of contact."""

    arcs: Arcs
    free_time: np.ndarray


def window(config: DwaConfig, twist: Twist) -> tuple[float, float, float, float]:
    """Lowest and highest speed and yaw rate that can be reached within one control period."""
    reach_v = config.acceleration * config.control_period
    reach_w = config.yaw_acceleration * config.control_period
    v = float(np.clip(twist.v, config.min_speed, config.max_speed))
    w = float(np.clip(twist.w, -config.max_yaw_rate, config.max_yaw_rate))
    return (
        max(config.min_speed, v - reach_v),
        min(config.max_speed, v + reach_v),
        max(-config.max_yaw_rate, w - reach_w),
        min(config.max_yaw_rate, w + reach_w),
    )


def candidates(config: DwaConfig, twist: Twist) -> tuple[np.ndarray, np.ndarray]:
    """Candidate speeds and yaw rates (n,) each: the window's limits and whole multiples of the steps between
    them, so that standing still, driving straight and turning on the spot are among them when in reach."""
    v_low, v_high, w_low, w_high = window(config, twist)
    v = _lattice(v_low, v_high, config.speed_step)
    w = _lattice(w_low, w_high, config.yaw_rate_step)
    return np.repeat(v, len(w)), np.tile(w, len(v))


def _lattice(low: float, high: float, step: float) -> np.ndarray:
    inside = step * np.arange(math.floor(low / step) + 1, math.ceil(high / step))
    return np.unique(np.concatenate([[low], inside, [high]]))


def evaluate(
    config: DwaConfig,
    v: np.ndarray,
    w: np.ndarray,
    pose: Pose,
    target: tuple[float, float],
    surroundings: Surroundings,
    max_speed: float | None = None,
    slip: Slip = NO_SLIP,
) -> Rollout:
    """Roll out and weigh the candidates v, w (n,) from `pose` (world, base) toward `target`.

    max_speed : what the velocity term and the choice aim at, when lower than the robot's own
    slip : how the robot moves aside on these arcs
    """
    start = np.array([pose.x, pose.y, pose.yaw])
    points = np.ascontiguousarray(surroundings.points, dtype=float).reshape(-1, 2)
    ranked = np.empty((len(points), 3))
    ranked[:, :2] = points
    ranked[:, 2] = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
    ranked = ranked[ranked[:, 2].argsort(kind="stable")]
    ground = surroundings.ground
    poses, heading, nearest, distance, unknown, tilt, free_time, rejection = roll_out(
        v, w, np.array([slip.turning, slip.driving]), start, np.array(target, float),
        config.steps, config.dt, config.heading_share,
        np.array([config.braking, config.yaw_braking]), config.reaction, config.creep_speed,
        0.5 * np.array([config.footprint.length, config.footprint.width]), config.contact_distance,
        config.speed_margin, config.escape_speed, np.array(config.leaving), ranked,
        _discs(config, surroundings.moving), ground.elevation.astype(float), ground.forbidden,
        np.array([ground.x_min, ground.y_min, ground.resolution]), _WHEELS, 
        np.array([math.tan(config.pitch_limit), math.tan(config.roll_limit)]),
    )  # fmt: skip
    weights = config.weights
    terms, total, chosen = weigh(
        v, heading, nearest, distance, unknown, tilt, rejection,
        weights.heading, weights.clearance, weights.velocity, weights.goal, weights.unknown, weights.tilt,
        config.max_speed if max_speed is None else max_speed, config.clearance_reach,
    )  # fmt: skip
    heading, clearance, velocity, goal, beneath = terms
    arcs = Arcs(v, w, poses, heading, clearance, velocity, goal, beneath, total, rejection, chosen)
    return Rollout(arcs, free_time)


def _discs(config: DwaConfig, moving: tuple[TrackedObstacle, ...]) -> np.ndarray:
    reach = config.footprint.radius + config.moving_margin
    discs = [(x, y, m.vx, m.vy, radius + reach) for m in moving for x, y, radius in outline_discs(m)]
    return np.array(discs, dtype=float).reshape(-1, 5)
