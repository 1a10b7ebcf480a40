"""Where DWA-RL learns: a flat meadow, bushes and rocks beside the way, people and vehicles that cross it.

The robot moves and meets things as in `scenes.kinematics`: the Husky's footprint, limits, lag and slip. What
it knows are outlines of what stands and, with a tracker's noise, discs with velocities of what moves. Its
target runs ahead of it along the straight way, as the waypoint of a planner does.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from planner.driver_config import DriverConfig, approach
from planner.dwa import Surroundings
from planner.dwa_rl import Window, open_window
from planner.dwa_rl_window import MovingHistory
from planner.frames import Status, TrackedObstacle
from planner.oracle import true_obstacles
from planner.tracking import POSITION_SIGMA, outline_discs
from planner.way_out import crowded, evasive_arc
from scenes.catalogue import CoverKind, Footprint
from scenes.crossings import crossing_traffic
from scenes.kinematic_kernel import FREE, SPEED, STATE_SIZE, YAW, YAW_RATE
from scenes.kinematics import HUSKY_RESPONSE, STEP_S, Outlines, advance
from scenes.pose import Pose, Twist, wrap_angle
from scenes.robot import HUSKY
from scenes.scenario import CoverObject
from scenes.terrain import Heightmap

TICK_S, MOST_TICKS = 0.1, 350
LOOK_AHEAD = 2.0
GOAL_RADIUS = 0.5
HALF = 16.0  # metres from the meadow's middle to its edge
BEAMS, BEAM_REACH, NEAR_BEAM = 36, 4.0, 2.0
POSITION_NOISE, VELOCITY_SIGMA = 0.25, 0.05
"""Share of a scan's error that a track keeps, and m/s: afresh at every tick."""

SPACING = 0.2  # metres between the points of an outline
RESPONSE = astuple(HUSKY_RESPONSE)


@dataclass(frozen=True)
class MotionReward:
    """The published code's, in its units, over `unit` of them: metres nearer, collision, arriving, and for
    each beam that meets something within 4 m a price over its length, dearer below 2 m. Left out: 5 for every
    tick in motion, whichever way.

    steering : a tick at full yaw rate against, or with, the heading of something that is about to cross the
        way: turning to where it comes from passes behind it. The paper has such a term, the code has not;
        this one is ours
    """

    progress: float = 200.0
    collision: float = -2000.0
    arrival: float = 500.0
    beam: float = -1.0
    near_beam: float = -3.5
    steering: float = 4.0
    unit: float = 200.0

    def __call__(
        self, nearer: float, status: Status, beams: np.ndarray, pose: Pose, w: float, moving: tuple
    ) -> float:
        """Of one tick: metres nearer to the goal, beams (n,) in metres, inf where one meets nothing, the
        robot's pose and yaw rate, and what moves."""
        paid = self.progress * nearer
        if status is Status.REACHED:
            paid += self.arrival
        elif status is Status.COLLIDED:
            paid += self.collision
        price = np.where(beams > NEAR_BEAM, self.beam, self.near_beam)
        paid += float((price / np.maximum(beams, 0.1)).sum())
        paid += self.steering * steering_behind(pose, w, moving)
        return paid / self.unit


def steering_behind(pose: Pose, w: float, moving: tuple[TrackedObstacle, ...]) -> float:
    """From -1 to 1: how much the yaw rate w turns against the heading of what will cross the robot's way
    within four seconds and five metres ahead; 0 where nothing does."""
    total = 0.0
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    for thing in moving:
        dx, dy = thing.x - pose.x, thing.y - pose.y
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        forward, leftward = cos * thing.vx + sin * thing.vy, cos * thing.vy - sin * thing.vx
        speed = math.hypot(forward, leftward)
        if speed < 0.2 or abs(leftward) < 0.2 * speed:
            continue
        seconds = -left / leftward
        if -0.5 < seconds < 4.0 and 0.0 < ahead + seconds * forward < 5.0:
            total -= (w / HUSKY.max_yaw_rate) * leftward / speed
    return min(max(total, -1.0), 1.0)


class CrossingWorld:
    """One robot on its way across the traffic; `rng` draws its drives, one after the other."""

    def __init__(self, rng: np.random.Generator, reward: MotionReward | None = None):
        self._rng, self._reward = rng, reward or MotionReward()
        self._driver = DriverConfig()
        cells = round(2.0 * HALF / 0.5) + 1
        flat = np.zeros((cells, cells))
        self._ground = Heightmap(flat, 0.5, flat.astype(np.uint8), flat.astype(np.uint8))
        self.reset()

    def reset(self) -> None:
        """Begin another drive, in which there is something to choose."""
        self._begin()
        while not self._window.admissible.any():
            self._begin()

    def _begin(self) -> None:
        rng = self._rng
        length = rng.uniform(8.0, 14.0)
        self._goal = (0.5 * length, 0.0)
        way = ((-0.5 * length, 0.0), self._goal)
        cover = self._beside(way, int(rng.integers(0, 9)))
        self._obstacles = crossing_traffic(
            rng, self._ground, cover, way, people=int(rng.integers(0, 4)), vehicles=int(rng.integers(0, 2))
        )
        self._state = np.zeros(STATE_SIZE)
        self._state[: YAW + 1] = way[0][0], 0.0, rng.uniform(-0.6, 0.6)
        self._standing, self._points = Outlines.of(self._ground, cover), _outlines(cover)
        self._history = MovingHistory()
        self._ticks, self.status = 0, Status.RUNNING
        self._look()

    def _beside(self, way, count: int) -> tuple[CoverObject, ...]:
        """Bushes beside the way that leave the robot a lane."""
        rng, found = self._rng, []
        for number in range(1, count + 1):
            size, side = rng.uniform(0.5, 1.8), rng.choice((-1.0, 1.0))
            x, y = rng.uniform(way[0][0] + 2.0, way[1][0] - 1.0), side * rng.uniform(0.65, 3.0)
            y += side * 0.5 * size
            found.append(CoverObject(id=number, kind=CoverKind.BUSH, x=x, y=y, length=size, width=size))
        return tuple(found)

    @property
    def over(self) -> bool:
        return self.status.final

    @property
    def window(self) -> Window:
        """What there is to choose from now; at least one row is admissible unless the drive is over."""
        return self._window

    @property
    def seconds(self) -> float:
        """Of the present drive."""
        return self._ticks * TICK_S

    def step(self, row: int) -> float:
        """Drive a tick at a row's velocity, then as the driver would while none is admissible; the reward."""
        paid = self._tick(_command(self._window, row))
        while not self.over and not self._window.admissible.any():
            paid += self._tick(self._without_choice())
        return paid

    def _without_choice(self) -> Twist:
        """The driver's own way out: evade what moves, else stand."""
        arcs = self._window.rollout.arcs
        evasion = evasive_arc(self._window.rollout, self._moving, self._driver.dwa.dt)
        return Twist(float(arcs.v[evasion]), float(arcs.w[evasion])) if evasion >= 0 else Twist()

    def _tick(self, command: Twist) -> float:
        before, steps = self._away(), round(TICK_S / STEP_S)
        met = advance(self._ground, self._state, command, steps, RESPONSE, self._standing)
        self._ticks += 1
        if met != FREE or self._run_into():
            self.status = Status.COLLIDED
        elif self._away() <= GOAL_RADIUS:
            self.status = Status.REACHED
        elif self._ticks >= MOST_TICKS and not self.over:
            self.status = Status.TIMEOUT
        self._look()
        nearer = before - self._away()
        return self._reward(nearer, self.status, self._beams(), self.pose, command.w, self._moving)

    @property
    def pose(self) -> Pose:
        x, y, yaw = self._state[: YAW + 1].tolist()
        return Pose(x, y, 0.0, yaw=float(wrap_angle(yaw)))

    def _run_into(self) -> bool:
        """Whether something that moves and the robot meet."""
        pose = self.pose
        robot = Footprint(pose.x, pose.y, pose.yaw, HUSKY.length, HUSKY.width, round=False)
        for thing in self._obstacles:
            outline = thing.footprint_at(self.seconds)
            away = math.hypot(outline.x - pose.x, outline.y - pose.y)
            if away <= outline.radius + HUSKY.circumscribed_radius and robot.gap(outline) <= 0.0:
                return True
        return False

    def _away(self) -> float:
        pose = self.pose
        return math.hypot(self._goal[0] - pose.x, self._goal[1] - pose.y)

    def _look(self) -> None:
        """Take in the moment and open the window on it."""
        pose, twist = self.pose, Twist(float(self._state[SPEED]), float(self._state[YAW_RATE]))
        truly = true_obstacles(self._obstacles, self.seconds)
        noise = self._rng.normal(size=(len(truly), 4)).tolist()
        self._moving = moving = tuple(map(_tracked, truly, noise))
        self._history.see(pose, moving)
        target = (min(pose.x + LOOK_AHEAD, self._goal[0]), 0.0)
        dwa, max_speed = approach(self._driver, self._driver.dwa, pose, target, self._away())
        around = Surroundings(self._points, moving)
        self._window = open_window(dwa, pose, twist, target, around, self._history, max_speed)
        if not self._window.admissible.any() and crowded(self._window.rollout):
            dwa = replace(dwa, moving_margin=self._driver.close_margin)
            self._window = open_window(dwa, pose, twist, target, around, self._history, max_speed)

    def _beams(self) -> np.ndarray:
        """(BEAMS,) metres from the robot's middle to what each meets, inf beyond the reach."""
        pose = self.pose
        found = [disc for thing in self._moving for disc in outline_discs(thing)]
        discs = np.array(found, float).reshape(-1, 3)
        points = np.column_stack([self._points, np.full(len(self._points), 0.5 * SPACING)])
        x, y, radius = np.concatenate([discs, points]).T
        away = np.hypot(x - pose.x, y - pose.y)
        near = away - radius < BEAM_REACH
        away, radius = np.maximum(away[near], 1e-6), radius[near]
        bearing = np.arctan2(y[near] - pose.y, x[near] - pose.x)
        beams = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)[:, None]
        off = np.abs((beams - bearing + math.pi) % (2.0 * math.pi) - math.pi)
        half = np.arcsin(np.minimum(radius / away, 1.0))
        met = np.where(off <= half, np.maximum(away - radius, 0.1), np.inf)
        return np.min(met, axis=1, initial=np.inf)


def _outlines(cover: tuple[CoverObject, ...]) -> np.ndarray:
    """(m, 2) points along the outlines of round cover."""
    rings = [np.zeros((0, 2))]
    for thing in cover:
        radius = thing.footprint.radius
        count = max(6, math.ceil(2.0 * math.pi * radius / SPACING))
        turn = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
        rings.append(np.column_stack([thing.x + radius * np.cos(turn), thing.y + radius * np.sin(turn)]))
    return np.concatenate(rings)


def _tracked(thing: TrackedObstacle, noise: list[float]) -> TrackedObstacle:
    """As a tracker has it; four standard normal numbers make its error."""
    sigma = POSITION_NOISE * POSITION_SIGMA[thing.kind]
    x, y, vx, vy = noise
    return TrackedObstacle(
        thing.object_id, thing.kind, thing.x + sigma * x, thing.y + sigma * y,
        thing.vx + VELOCITY_SIGMA * vx, thing.vy + VELOCITY_SIGMA * vy, thing.radius,
    )  # fmt: skip


def _command(window: Window, row: int) -> Twist:
    index = window.view.order[row]
    return Twist(float(window.rollout.arcs.v[index]), float(window.rollout.arcs.w[index]))
