"""The Markov decision process as a Gymnasium environment, `CoverNav-v0`."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from numbers import Integral
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding

from planner.elevation_map import MapConfig
from planner.episode import Ground, Grounds, Task, check_reachable
from planner.frames import GridMap, Percept, Perception, Status
from planner.line_of_sight import View, VisibleFraction, views_at, visible_fraction
from planner.map_sight import MapSight
from planner.observation import (
    HIGH,
    LOW,
    STATE_HIGH,
    STATE_LOW,
    Observation,
    observe,
    on_patch,
    slopes_ahead,
)
from planner.perception import Perceiver, Sensing
from planner.reward import REWARDS, Moment, Reward
from planner.sensed_belief import SensedBelief
from planner.sensed_exposure import sensed_exposure
from planner.shelter import Shelter
from scenes.kinematics import KinematicWorld
from scenes.pose import Pose, Twist, wrap_angle
from scenes.robot import HUSKY
from scenes.scenario import Scenario
from scenes.sensors import CameraConfig, LidarConfig
from scenes.world import DrivenWorld, RobotLostError

DECISION_S = 0.25
GOAL_RADIUS = 0.5
ROLLED_OVER_UP = math.cos(math.radians(60.0))
REMEMBERED = 8  # positions, for r_elev

TASK_OPTIONS = tuple(field.name for field in fields(Task))


class Dynamics(StrEnum):
    """How the robot moves: rigid bodies and sliding wheels, or a motion model fitted to them."""

    PHYSICS = "physics"
    KINEMATIC = "kinematic"


SENSING = {
    Dynamics.PHYSICS: Sensing(camera_period=2),
    Dynamics.KINEMATIC: Sensing(
        lidar=LidarConfig(azimuths=450), camera=CameraConfig(width=160, height=120), camera_period=4
    ),
}
"""At four decisions a second: the mission's sensors, whose camera looks twice a second; and, where speed
matters, every other azimuth of the lidar and every other pixel of a camera that looks once a second."""

MAPPING = {Dynamics.PHYSICS: MapConfig(), Dynamics.KINEMATIC: MapConfig(size=30.0)}
"""The mission's map; and, where speed matters, as much of it as observations show, whichever way it heads."""


EXPOSURE_PERIOD = {Dynamics.PHYSICS: 2, Dynamics.KINEMATIC: 4}
"""Decisions for which what the map tells of exposure is good, unless an observer has been spotted."""


@dataclass(frozen=True, eq=False)
class _Expected:
    """What observers would see of the robot, (rows, cols) over a map: those it knew of then, and those whom
    it has not seen yet, None where there are none."""

    known: tuple[int, ...]
    grid: GridMap
    exposure: np.ndarray
    belief: np.ndarray | None


class CoverNavEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A Husky on its way to a goal, watched or not, deciding four times a second.

    | action | meaning | range |
    |---|---|---|
    | 0 | forward speed, (a + 1) / 2 of 1.0 m/s | -1..1 |
    | 1 | yaw rate, a of 1.5 rad/s, left positive | -1..1 |

    Both are held for a decision period. Observations are tabulated at `planner.observation.observe`. An
    episode terminates when the robot is within `GOAL_RADIUS` of the goal, at whatever speed, when it touches
    anything, when it has rolled over and when it has left the map; it is truncated after `max_steps`.

    info : `terms`, every term of the reward of this step by name; `status`, a `planner.frames.Status`;
        `pose`, the true one; `exposed_s`, visible seconds of the episode; `success`; after a step also
        `visibility`, the visible fraction now, and `hidden`, the share that cover hides

    terrain, goal_distance, observers, patrols, known, obstacles : what episodes are drawn from, see
        `planner.episode.Task`
    reward : a name of `planner.reward.REWARDS`, or a reward
    dynamics : `physics` or `kinematic`; perception : `lidar` or `oracle`
    scenario : drive this one, as it stands, instead of drawn ones; with `goal_distance` among the options
        of a reset, draw drives on its ground
    variety : how many grounds of a terrain there are
    exposure_layer : whether the layers of exposure and belief are filled, which costs time; zeros otherwise.
        The belief stays dark where the robot has been told of all observers

    percept : what the robot knows now, as a planning method takes it; None before the first reset

    `reset` takes a seed, from which all of the episode follows, and options: any of those six, `scenario`
    and `max_steps`. Raises ValueError for what is unknown or out of range, ScenarioError for a scenario
    without a reachable goal.
    """

    metadata = {"render_modes": [], "render_fps": 4}  # noqa: RUF012 - Gymnasium's own form

    def __init__(
        self,
        terrain: str = "normal",
        *,
        reward: str | Reward = "corrected",
        dynamics: str = Dynamics.KINEMATIC,
        perception: str = Perception.LIDAR,
        goal_distance: float = 12.0,
        observers: int = 1,
        patrols: bool = False,
        known: bool = True,
        obstacles: int = 0,
        scenario: Scenario | None = None,
        variety: int = 12,
        max_steps: int = 100,
        exposure_layer: bool = True,
        render_mode: str | None = None,
    ):
        if not (reward in REWARDS if isinstance(reward, str) else callable(reward)):
            raise ValueError(f"reward {reward!r} is none of {', '.join(REWARDS)}")
        self.task = Task(terrain, goal_distance, observers, patrols, known, obstacles)  # type: ignore[arg-type]
        self.reward = REWARDS[reward] if isinstance(reward, str) else reward
        self.dynamics, self.perception = Dynamics(dynamics), Perception(perception)
        self.max_steps, self.render_mode = _at_least_one(max_steps), render_mode
        self.observation_space = spaces.Dict(
            layers=spaces.Box(LOW, HIGH, dtype=np.float32),
            state=spaces.Box(STATE_LOW, STATE_HIGH, dtype=np.float32),
        )
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.exposure_layer = exposure_layer
        self._grounds = Grounds(variety)
        self._own = None if scenario is None else Ground(_checked(scenario))
        self._world: DrivenWorld | None = None
        self.percept: Percept | None = None

    # --- an episode ------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        self.close()
        ground, self.scenario = self._drawn(dict(options or {}))
        self._ground, self._rays = ground, ground.rays()
        self._world = self._make_world()
        rng = np.random.default_rng(self.np_random.integers(2**63))
        self._perceiver = Perceiver(
            self.scenario, self.perception, rng, MAPPING[self.dynamics], SENSING[self.dynamics]
        )
        self.status, self.steps, self.exposed_s = Status.RUNNING, 0, 0.0
        self._elevations: deque[float] = deque(maxlen=REMEMBERED)
        self._expected: _Expected | None = None
        route = (self.scenario.start.x, self.scenario.start.y), (self.scenario.goal.x, self.scenario.goal.y)
        self._belief = SensedBelief(route, rng.spawn(1)[0]) if self._untold else None
        self._pose = self._world.pose
        percept, views = self._sense(self._world)
        seen = visible_fraction(self._rays, views, self._pose)
        return self._observe(percept, views, seen, 0.0), self._info({})

    def prepare(self, *, seed: int, options: dict[str, Any] | None = None) -> None:
        """Make the ground that a reset with the same will draw, so that it need not be waited for then;
        nothing else changes. Raises ValueError as `reset` does."""
        given = dict(options or {})
        wanted, _ = given.pop("scenario", None), given.pop("max_steps", None)
        if wanted is None and self._own is None:
            self._grounds.draw(replace(self.task, **_task_options(given)), seeding.np_random(seed)[0])

    def _drawn(self, options: dict[str, Any]) -> tuple[Ground, Scenario]:
        wanted = options.pop("scenario", None)
        most = options.pop("max_steps", None)
        self.steps_allowed = self.max_steps if most is None else _at_least_one(most)
        given = _task_options(options)
        task = replace(self.task, **given)
        own = self._own if wanted is None else Ground(_checked(wanted))
        if own is None:
            own = self._grounds.draw(task, self.np_random)
        elif "goal_distance" not in given:
            others = sorted(given.keys() - {"terrain"})
            if others:
                raise ValueError(f"{others[0]} is for drives on a scenario's ground: give goal_distance, too")
            check_reachable(own.scenario)
            self._untold = any(not observer.known for observer in own.scenario.observers)
            return own, own.scenario
        self._untold = not task.known
        return own, own.draw(task, self.np_random)

    def _make_world(self) -> DrivenWorld:
        scenario, ground = self.scenario, self._ground
        if self.dynamics is Dynamics.KINEMATIC:
            return KinematicWorld(
                ground.heightmap, scenario.cover, scenario.obstacles, scenario.start, outlines=ground.outlines
            )
        from scenes.physics import World  # pybullet is not for those who never ask for it

        return World(ground.heightmap, scenario.cover, scenario.obstacles, scenario.start)

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold an action for a decision period. Raises ValueError for one that is not two finite numbers."""
        if self._world is None or self.status.final:
            raise ResetNeeded("the episode is over or has not begun; call reset first")
        command, before = command_of(action), self._pose
        lost = False
        try:
            self._world.step(command, DECISION_S)
        except RobotLostError:
            lost = True
        self._pose = self._world.pose
        self.status = Status.STOPPED if lost else self._judge(self._world)
        self.steps += 1
        percept, views = self._sense(self._world)
        seen = visible_fraction(self._rays, views, self._pose)
        self.exposed_s += DECISION_S * seen.united
        shelter = self._ground.cover.shelter(self._rays, views, seen, self._pose)
        self._elevations.appendleft(before.z)
        moment = self._moment(before, seen, shelter, percept)
        terms = self.reward(moment)
        truncated = not self.status.final and self.steps >= self.steps_allowed
        turned = float(wrap_angle(self._pose.yaw - before.yaw))
        observation = self._observe(percept, views, seen, turned)
        info = self._info(terms) | {"visibility": moment.exposure, "hidden": moment.hidden}
        return observation, terms["total"], self.status.final, truncated, info

    def _judge(self, world: DrivenWorld) -> Status:
        if world.up < ROLLED_OVER_UP:
            return Status.ROLLED_OVER
        if world.touching():
            return Status.COLLIDED
        goal = self.scenario.goal
        away = math.hypot(goal.x - self._pose.x, goal.y - self._pose.y)
        return Status.REACHED if away <= GOAL_RADIUS else Status.RUNNING

    def _sense(self, world: DrivenWorld) -> tuple[Percept, tuple[View, ...]]:
        """What the robot knows now, and what all observers truly look at."""
        scenario = self.scenario
        self._rays.set_walkers(scenario.obstacles, scenario.observers, world.time_s)
        goal = scenario.goal.x, scenario.goal.y
        self.percept = percept = self._perceiver.perceive(
            self._rays, self._pose, world.twist, world.time_s, goal
        )
        return percept, views_at(scenario.observers, self._ground.heightmap, world.time_s)

    def _observe(
        self, percept: Percept, views: tuple[View, ...], seen: VisibleFraction, turned: float
    ) -> Observation:
        known = views_at(percept.observers, self._ground.heightmap, percept.time_s)
        if known != views:
            seen = visible_fraction(self._rays, known, self._pose)
        if not self.exposure_layer:
            return observe(percept, heading_change=turned, visible=seen.united)
        expected, pose = self._expect(percept), percept.pose
        belief = None if expected.belief is None else on_patch(expected.grid, expected.belief, pose)
        exposure = on_patch(expected.grid, expected.exposure, pose)
        return observe(
            percept, heading_change=turned, visible=seen.united, exposure=exposure, belief=belief
        )

    def _expect(self, percept: Percept) -> _Expected:
        """What the robot's own map says that observers would see of it about here."""
        due = self.steps % EXPOSURE_PERIOD[self.dynamics] == 0
        expected = self._expected
        if expected is None or due or percept.known_observers != expected.known:
            on_map, belief = MapSight.of(percept), None
            if self._belief is not None:
                self._belief.look(percept, on_map)
                belief = self._belief.exposure(on_map)
            exposure = sensed_exposure(percept, on_map)
            self._expected = expected = _Expected(percept.known_observers, percept.grid, exposure, belief)
        return expected

    def _moment(self, before: Pose, seen: VisibleFraction, shelter: Shelter, percept: Percept) -> Moment:
        after, goal, cover = self._pose, self.scenario.goal, self._ground.cover
        bearing = math.atan2(goal.y - after.y, goal.x - after.x)
        return Moment(
            previous_goal_distance=math.hypot(goal.x - before.x, goal.y - before.y),
            goal_distance=math.hypot(goal.x - after.x, goal.y - after.y),
            previous_heading=before.yaw,
            heading=after.yaw,
            heading_error=float(wrap_angle(bearing - after.yaw)),
            roll=after.roll,
            pitch=after.pitch,
            elevation=after.z,
            previous_elevations=tuple(self._elevations),
            cover_centre=cover.centre_distance(after),
            cover_surface=cover.surface_distance(after),
            shelter=shelter.distance,
            hidden=shelter.hidden,
            exposure=seen.united,
            slopes_ahead=tuple(slopes_ahead(percept).tolist()),
            seconds=DECISION_S,
            status=self.status,
        )

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        return {
            "terms": terms,
            "status": self.status,
            "pose": self._pose,
            "exposed_s": self.exposed_s,
            "success": self.status is Status.REACHED,
        }

    def close(self) -> None:
        """Free the world; safe to call twice."""
        if self._world is not None:
            self._world.close()
            self._world = None


def _task_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those that are given. Raises ValueError for one that no task has."""
    unknown = sorted(set(options) - set(TASK_OPTIONS))
    if unknown:
        known = ", ".join((*TASK_OPTIONS, "scenario", "max_steps"))
        raise ValueError(f"option {unknown[0]!r} is none of {known}")
    return {name: value for name, value in options.items() if value is not None}


def _at_least_one(steps: int) -> int:
    if not isinstance(steps, Integral) or isinstance(steps, bool) or steps < 1:
        raise ValueError(f"an episode has a whole number of steps, at least one, got {steps!r}")
    return int(steps)


def _checked(scenario: Scenario) -> Scenario:
    if not isinstance(scenario, Scenario):
        raise ValueError(f"scenario must be a scenes.scenario.Scenario, got {scenario!r:.60}")
    return scenario


def command_of(action: np.ndarray) -> Twist:
    """The velocities that an action (2,) from -1 to 1 stands for (TERP's), clipped to that range.

    Raises ValueError for anything but two finite numbers."""
    numbers = np.asarray(action, float).ravel()
    if numbers.shape != (2,) or not np.isfinite(numbers).all():
        raise ValueError(f"an action is two finite numbers, speed and yaw rate, got {action!r}")
    forward, turn = np.clip(numbers, -1.0, 1.0).tolist()
    return Twist(0.5 * (forward + 1.0) * HUSKY.max_speed, turn * HUSKY.max_yaw_rate)


def action_of(command: Twist) -> np.ndarray:
    """The action (2,) float32 whose command comes nearest."""
    action = (2.0 * command.v / HUSKY.max_speed - 1.0, command.w / HUSKY.max_yaw_rate)
    return np.clip(action, -1.0, 1.0).astype(np.float32)
