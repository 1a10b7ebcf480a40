"""Follows a covert route over the true map with everything known: what the other methods are measured by."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.cost_map import CostConfig, ground_near
from planner.cover import best_cover
from planner.covert_route import BALANCED, CovertPlanner, CovertRoute
from planner.driver import Driver, DriverConfig
from planner.frames import Decision, Percept, Status
from planner.methods.dwa import GROUND_REACH
from planner.no_route import NoRoute
from scenes.pose import Twist
from scenes.rays import RayScene
from scenes.scenario import Scenario

Choice = Callable[[CovertPlanner, tuple[float, float], tuple[float, float], float], CovertRoute]
"""From planner, start, goal and yaw to the route to follow."""


def shortest(planner: CovertPlanner, start, goal, yaw: float) -> CovertRoute:
    return planner.route(start, goal, 0.0, yaw)


def balanced(planner: CovertPlanner, start, goal, yaw: float) -> CovertRoute:
    return planner.route(start, goal, BALANCED, yaw)


def most_hidden(planner: CovertPlanner, start, goal, yaw: float) -> CovertRoute:
    return planner.bound(start, goal, yaw=yaw)


@dataclass(frozen=True)
class FollowConfig:
    """Metres.

    look_ahead, nearest_waypoint : how far along the route the waypoint lies at most and at least
    corner : how far the straight line to the waypoint may stray from the route
    lost : farther from its route the robot plans a new one
    """

    look_ahead: float = 1.4
    nearest_waypoint: float = 0.5
    corner: float = 0.12
    lost: float = 1.2
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
        self._driver = Driver(self.config.driver)
        self._planner: CovertPlanner | None = None
        self.reset()

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over the true scenario; `rays` holds its ground and cover."""
        self._planner = CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers, rays)
        self._places = np.zeros((0, 2))

    def reset(self) -> None:
        self._driver.reset()
        self._places = np.zeros((0, 2))
        self._corners = np.zeros((0, 2))
        self._at = 0

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_planner": None}

    def decide(self, percept: Percept) -> Decision:
        try:
            self._keep_route(percept)
        except NoRoute as reason:
            return Decision(Twist(), note=f"no route: {reason}", failure=Status.UNREACHABLE)
        rest = self._places[self._at :]
        waypoint = self._waypoint(percept, rest)
        ground = ground_near(percept.grid, percept.pose.x, percept.pose.y, GROUND_REACH, self.config.cost)
        driven = self._driver.drive(percept, waypoint, ground)
        return Decision(
            driven.command, waypoint, rest, None, driven.arcs,
            cover_id=best_cover(percept),
            note=driven.note, failure=Status.STUCK if driven.stuck else None,
        )  # fmt: skip

    def _keep_route(self, percept: Percept) -> None:
        """Advance along the route, or plan one where there is none or it is lost."""
        here = np.array([percept.pose.x, percept.pose.y])
        if len(self._places):
            ahead = self._places[self._at : self._at + round(3.0 / self.config.spacing)]
            distance = np.hypot(*(ahead - here).T)
            nearest = int(np.argmin(distance))
            if distance[nearest] <= self.config.lost:
                self._at += nearest
                return
        if self._planner is None:
            raise RuntimeError("the method must be briefed with the scenario before it decides")
        route = self._choose(self._planner, (percept.pose.x, percept.pose.y), percept.goal, percept.pose.yaw)
        self._places, self._at = _evenly(route.points, self.config.spacing), 0

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


def _evenly(points: np.ndarray, spacing: float) -> np.ndarray:
    """Places (n, 2) along a polyline (k, 2), both ends among them."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / spacing) + 1))
    return np.column_stack([np.interp(at, along, points[:, axis]) for axis in (0, 1)])
