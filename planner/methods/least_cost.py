"""Least-cost waypoints over the robot's own map, driven to by the dynamic window; no learning."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from planner.cost_map import CostConfig, CostMap, build, ground_near, open_about, shunning
from planner.cover import best_cover
from planner.driver import Driver
from planner.driver_config import DriverConfig
from planner.frames import CostPatch, Decision, Percept, Status
from planner.methods.dwa import GROUND_REACH
from planner.route import Route, least_cost_route, line_cost, route_cost
from scenes.pose import Twist
from scenes.robot import HUSKY

ASTRAY = 0.8
"""Metres from its route at which the robot no longer follows it."""


@dataclass(frozen=True)
class LeastCostConfig:
    """Metres and seconds.

    replan_period : between routes
    look_ahead : how far along the route the waypoint may lie; at least `nearest_waypoint`
    detour : how much dearer than the route's own stretch the straight line to a waypoint may be
    points_per_metre : points of cost that weigh as much as a metre of way
    loyalty : share by which a new route must be cheaper than the rest of the old one to replace it
    patience : without any route, until the goal counts as unreachable
    failed : recoveries in one region after which routes are led past what lies between the robot and its
        waypoint, and all within `berth` of that
    """

    replan_period: float = 0.4
    look_ahead: float = 2.0
    nearest_waypoint: float = 0.6
    detour: float = 1.1
    points_per_metre: float = 10.0
    loyalty: float = 0.08
    patience: float = 4.0
    failed: int = 2
    berth: float = 0.6
    cost: CostConfig = field(default_factory=CostConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)


@dataclass(frozen=True)
class Plan:
    """A route as world points (k, 2) over a map whose cost per metre is `cost`."""

    time_s: float
    map: CostMap
    cost: np.ndarray
    patch: CostPatch
    points: np.ndarray
    reason: str

    def grid_points(self, points: np.ndarray) -> np.ndarray:
        """World points as (row, col), not rounded."""
        return (points[..., ::-1] - (self.map.y_min, self.map.x_min)) / self.map.resolution


class LeastCost:
    """Replans over the newest map, keeps to its route unless another is clearly better."""

    name = "least_cost"

    def __init__(self, config: LeastCostConfig | None = None):
        self.config = config or LeastCostConfig()
        self.driver = Driver(self.config.driver)
        self._plan: Plan | None = None
        self._no_route_since: float | None = None
        self._shunned: list[tuple[float, float]] = []
        self._recoveries = 0

    def reset(self) -> None:
        self.driver.reset()
        self._plan = None
        self._no_route_since = None
        self._shunned = []
        self._recoveries = 0

    def decide(self, percept: Percept) -> Decision:
        self._learn_from_failure(percept)
        plan = self._plan
        if plan is None or percept.time_s - plan.time_s >= self.config.replan_period - 1e-6:
            plan = self._plan = self._make_plan(percept)
        if not len(plan.points):
            return self._without_route(percept, plan)
        self._no_route_since = None
        rest = self._rest_of_route(percept, plan)
        waypoint = self._waypoint(percept, plan, rest)
        ground = ground_near(percept.grid, percept.pose.x, percept.pose.y, GROUND_REACH, self.config.cost)
        driven = self.driver.drive(percept, waypoint, ground)
        return Decision(
            driven.command, waypoint, rest, plan.patch, driven.arcs,
            cover_id=best_cover(percept),
            note=driven.note, failure=Status.STUCK if driven.stuck else None,
        )  # fmt: skip

    def _learn_from_failure(self, percept: Percept) -> None:
        """Shun the place that the driver cannot get past, and look for another way at once."""
        recoveries, self._recoveries = self._recoveries, self.driver.recoveries
        plan = self._plan
        failed = self._recoveries > max(recoveries, self.config.failed - 1)
        if not failed or plan is None or not len(plan.points):
            return
        here, waypoint = percept.pose, self._waypoint(percept, plan, self._rest_of_route(percept, plan))
        self._shunned.append((0.5 * (here.x + waypoint[0]), 0.5 * (here.y + waypoint[1])))
        self._plan = None

    def _without_route(self, percept: Percept, plan: Plan) -> Decision:
        if self._no_route_since is None:
            self._no_route_since = percept.time_s
        waited = percept.time_s - self._no_route_since
        return Decision(
            Twist(),
            cost=plan.patch,
            note=f"no route: {plan.reason}",
            failure=Status.UNREACHABLE if waited > self.config.patience else None,
        )

    # --- routes ----------------------------------------------------------------------------------

    def _make_plan(self, percept: Percept) -> Plan:
        cost_map = build(percept.grid, self.config.cost)
        if self._shunned:
            cost_map = shunning(cost_map, self._shunned, self.config.berth)
        cost = 1.0 + cost_map.total / self.config.points_per_metre
        here = np.array([percept.pose.x, percept.pose.y])
        dearest = self._dearest
        blocked = percept.grid.obstacle
        # Where the robot stands, and the goal when it is close to something, the rim does not forbid.
        open_about(cost, cost_map, here, HUSKY.circumscribed_radius, dearest, blocked)
        open_about(cost, cost_map, np.array(percept.goal), HUSKY.inscribed_radius, dearest, blocked)
        start = cost_map.cell(*here)
        if 0 <= start[0] < cost.shape[0] and 0 <= start[1] < cost.shape[1]:
            cost[start] = min(cost[start], dearest)
        goal = (
            (percept.goal[1] - cost_map.y_min) / cost_map.resolution,
            (percept.goal[0] - cost_map.x_min) / cost_map.resolution,
        )
        route, cost, patch = self._find_route(percept, cost_map, cost, start, goal)
        plan = Plan(
            percept.time_s, cost_map, cost, patch,
            cost_map.centre(*route.cells.T) if route.found else np.zeros((0, 2)), route.reason,
        )  # fmt: skip
        return self._keep_old(percept, plan, route)

    def _find_route(
        self,
        percept: Percept,
        cost_map: CostMap,
        cost: np.ndarray,
        start: tuple[int, int],
        goal: tuple[float, float],
    ) -> tuple[Route, np.ndarray, CostPatch]:
        """The route over `cost` (rows, cols) per metre, from a cell to a (row, col) that need not be whole;
        with the cost that it is the cheapest for, and what to draw."""
        return least_cost_route(cost, cost_map.resolution, start, goal), cost, cost_map.patch()

    def _keep_old(self, percept: Percept, plan: Plan, route: Route) -> Plan:
        """The new plan, along the old route where that is still about as good.

        What the map tells of a narrow passage wavers by a cell from scan to scan; a route that leads through
        one holds while the body fits."""
        old = self._plan
        if old is None or not len(old.points) or not route.found:
            return plan
        rest = self._rest_of_route(percept, old)
        cells = np.rint(plan.grid_points(rest)).astype(int)
        if (cells < 0).any() or (cells >= plan.cost.shape).any():
            return plan
        off_route = float(np.hypot(*(rest[0] - (percept.pose.x, percept.pose.y))))
        to_go = float(np.hypot(*(rest[-1] - percept.goal)))
        cost = self._lenient(plan)
        old_cost = off_route + route_cost(cost, plan.map.resolution, cells) + to_go
        if off_route > ASTRAY or old_cost * (1.0 - self.config.loyalty) > route.cost:
            return plan
        return replace(plan, cost=cost, points=rest, reason="")

    def _lenient(self, plan: Plan) -> np.ndarray:
        """The plan's cost (rows, cols), the dearest instead of inf where the robot would just fit."""
        return np.where(np.isinf(plan.cost) & plan.map.tight, self._dearest, plan.cost)

    @property
    def _dearest(self) -> float:
        return 1.0 + 100.0 / self.config.points_per_metre

    def _rest_of_route(self, percept: Percept, plan: Plan) -> np.ndarray:
        """(k, 2) the route's points from the one nearest to the robot on."""
        offsets = plan.points - (percept.pose.x, percept.pose.y)
        return plan.points[int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1]))) :]

    def _waypoint(self, percept: Percept, plan: Plan, rest: np.ndarray) -> tuple[float, float]:
        """The farthest point of the route in reach to which the straight line is not much dearer."""
        here = np.array([percept.pose.x, percept.pose.y])
        resolution = plan.map.resolution
        cells = np.rint(plan.grid_points(rest)).astype(int)
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rest, axis=0).T))])
        last = int(np.searchsorted(lengths, self.config.look_ahead))
        best = rest[min(int(np.searchsorted(lengths, self.config.nearest_waypoint)), len(rest) - 1)]
        origin = plan.grid_points(here)
        for index in range(min(last, len(rest) - 1), 0, -1):
            if lengths[index] < self.config.nearest_waypoint:
                break
            straight = line_cost(plan.cost, resolution, origin, cells[index].astype(float))
            if straight <= self.config.detour * route_cost(plan.cost, resolution, cells[: index + 1]) + 0.1:
                best = rest[index]
                break
        at_end = math.dist(best, rest[-1]) < 1e-9
        if at_end and math.dist(best, percept.goal) < 2.0 * resolution:
            return percept.goal
        return float(best[0]), float(best[1])
