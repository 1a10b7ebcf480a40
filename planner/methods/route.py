"""Follows a covert route over the true map with everything known: what the other methods are measured by."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from planner.cost_map import CostConfig, ground_near
from planner.cover import best_cover
from planner.covert_route import BALANCED, CovertPlanner, CovertRoute
from planner.driver import Driver
from planner.driver_config import DriverConfig
from planner.exposure import common_cycle
from planner.frames import Decision, Percept, Status
from planner.methods.dwa import GROUND_REACH
from planner.no_route import NoRoute
from planner.space_time import SpaceTimePlanner
from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.scenario import Scenario

MOST_HIDDEN_IN_TIME = 0.95
"""Exposure weight of plans against the clock: hidden seconds count, too, or it would wait for ever."""


class Whereabouts(Protocol):
    """Where the robot is and goes to, and when."""

    @property
    def time_s(self) -> float: ...
    @property
    def pose(self) -> Pose: ...
    @property
    def goal(self) -> tuple[float, float]: ...


Choice = Callable[[CovertPlanner, Whereabouts], CovertRoute]
"""From the planner and where the robot is to the route to follow."""


def shortest(planner: CovertPlanner, percept: Whereabouts) -> CovertRoute:
    return planner.route(*_ends(percept), 0.0, percept.pose.yaw)


def balanced(planner: CovertPlanner, percept: Whereabouts) -> CovertRoute:
    """By the patrols' mean exposure, where there are any."""
    return planner.route(*_ends(percept), BALANCED, percept.pose.yaw)


def most_hidden(planner: CovertPlanner, percept: Whereabouts) -> CovertRoute:
    """Against the clock where an observer walks, of at most twice the shortest's length where none does."""
    yaw, now = percept.pose.yaw, percept.time_s
    if not common_cycle(planner.observers):
        return planner.bound(*_ends(percept), yaw=yaw)
    timed = SpaceTimePlanner(planner, now).route(*_ends(percept), MOST_HIDDEN_IN_TIME)
    # Its cells are coarse: where there is no cover to wait in, a straight way at once may be seen less.
    ways = [planner.route(*_ends(percept), weight, yaw) for weight in (0.0, BALANCED)]
    static = [planner.along(way.points, weight=way.weight, yaw=yaw, begun_s=now) for way in ways]
    return min(timed, *static, key=lambda way: way.exposed_s)


def _ends(percept: Whereabouts) -> tuple[tuple[float, float], tuple[float, float]]:
    return (percept.pose.x, percept.pose.y), percept.goal


@dataclass(frozen=True)
class FollowConfig:
    """Metres.

    look_ahead, nearest_waypoint : how far along the route the waypoint lies at most and at least
    corner : how far the straight line to the waypoint may stray from the route
    lost : farther from its route the robot plans a new one
    failed : recoveries in one region after which it leads its route past what lies between it and its
        waypoint, and all within `berth` of that
    late : so many seconds behind a plan against the clock, too; early : it may be so many ahead of it
    """

    look_ahead: float = 1.4
    nearest_waypoint: float = 0.5
    corner: float = 0.12
    lost: float = 1.2
    failed: int = 2
    berth: float = 0.6
    late: float = 4.0
    early: float = 1.2
    spacing: float = 0.1
    cost: CostConfig = field(default_factory=CostConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)


class FollowRoute:
    """Plans once, then keeps to the route with the dynamic window; plans anew when it has lost it.

    It must be briefed with the truth before it decides.
    """

    def __init__(self, name: str, choose: Choice, config: FollowConfig | None = None):
        self.name, self._choose = name, choose
        self.config = config or FollowConfig()
        self.driver = Driver(self.config.driver)
        self._planner: CovertPlanner | None = None
        self._recoveries = 0
        self.reset()

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over the true scenario; `rays` holds its ground and cover."""
        self._planner = CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers, rays)
        self._places = np.zeros((0, 2))

    def reset(self) -> None:
        self.driver.reset()
        if self._planner is not None and self._recoveries:
            self._planner.shun_nothing()
        self._places = np.zeros((0, 2))
        self._due: np.ndarray | None = None
        self._at = 0
        self._recoveries = 0

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_planner": None}

    def decide(self, percept: Percept) -> Decision:
        try:
            self._keep_route(percept)
        except NoRoute as reason:
            return Decision(Twist(), note=f"no route: {reason}", failure=Status.UNREACHABLE)
        rest = self._places[self._at : self._until(percept.time_s)]
        if len(rest) < 2 and self._due is not None and math.dist(rest[0], percept.goal) > 0.1:
            waits = f"waiting in cover, {self._due[self._at + 1] - percept.time_s:.0f} s left"
            return Decision(Twist(), percept.goal, self._places[self._at :], note=waits)
        waypoint = self._waypoint(percept, rest)
        ground = ground_near(percept.grid, percept.pose.x, percept.pose.y, GROUND_REACH, self.config.cost)
        driven = self.driver.drive(percept, waypoint, ground)
        return Decision(
            driven.command, waypoint, rest, None, driven.arcs,
            cover_id=best_cover(percept),
            note=driven.note, failure=Status.STUCK if driven.stuck else None,
        )  # fmt: skip

    def _keep_route(self, percept: Percept) -> None:
        """Advance along the route, or plan one where there is none or it is lost."""
        here, ahead = np.array([percept.pose.x, percept.pose.y]), self._places[:0]
        recoveries, self._recoveries = self._recoveries, self.driver.recoveries
        failed = len(self._places) > 0 and max(recoveries, self.config.failed - 1) < self._recoveries
        if len(self._places):
            ahead = self._places[self._at : self._at + round(3.0 / self.config.spacing)]
            distance = np.hypot(*(ahead - here).T)
            nearest = int(np.argmin(distance))
            if distance[nearest] <= self.config.lost and not self._late(percept.time_s) and not failed:
                self._at += nearest
                return
        if self._planner is None:
            raise RuntimeError("the method must be briefed with the scenario before it decides")
        if failed:
            x, y = 0.5 * (here + self._waypoint(percept, ahead))
            self._planner.shun(float(x), float(y), self.config.berth)
        route = self._choose(self._planner, percept)
        self._places, due = _evenly(route.points, self.config.spacing, route.times)
        self._due = None if due is None else percept.time_s + due
        self._at = 0

    def _late(self, time_s: float) -> bool:
        return self._due is not None and time_s - self._due[self._at] > self.config.late

    def _until(self, time_s: float) -> int | None:
        """Index of the first place that it is too early to head for, None where there is none."""
        if self._due is None:
            return None
        ahead = np.flatnonzero(self._due[self._at + 1 :] > time_s + self.config.early)
        return self._at + 1 + int(ahead[0]) if len(ahead) else None

    def _waypoint(self, percept: Percept, rest: np.ndarray) -> tuple[float, float]:
        """The farthest place in reach to which the straight line keeps near the route."""
        here = np.array([percept.pose.x, percept.pose.y])
        last = min(round(self.config.look_ahead / self.config.spacing), len(rest) - 1)
        first = min(round(self.config.nearest_waypoint / self.config.spacing), last)
        for index in range(last, first, -1):
            if _stray(here, rest[index], rest[:index]) <= self.config.corner:
                return float(rest[index, 0]), float(rest[index, 1])
        return float(rest[first, 0]), float(rest[first, 1])


def _stray(begin: np.ndarray, end: np.ndarray, places: np.ndarray) -> float:
    """Greatest distance of places (k, 2) from the straight line between two points, less what the first of
    them is off it already."""
    along = end - begin
    length = float(math.hypot(*along))
    if length <= 0.0 or not len(places):
        return 0.0
    offset = places - begin
    return float(np.abs(along[0] * offset[1:, 1] - along[1] * offset[1:, 0]).max(initial=0.0) / length)


def _evenly(
    points: np.ndarray, spacing: float, times: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Places (n, 2) along a polyline (k, 2), both ends among them, and when they are due (n,): where the
    polyline waits, its place is due when it may be left."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / spacing) + 1))
    places = np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])
    if times is None:
        return places, None
    # Of points at one place the last one counts.
    last = np.append(np.diff(along) > 1e-9, True)
    return places, np.interp(at, along[last], times[last])
