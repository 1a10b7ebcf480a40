"""The paper's learner when it drives: attention makes a cost map, the cost map a waypoint, and the dynamic
window drives there (Weerakoon et al. 2022; the CoverNav paper's "DDPG to DWA")."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from planner.attention_cost import IMPASSABLE, PATCH_RESOLUTION, cost_map
from planner.checkpoint import load_policy
from planner.cost_map import CostConfig, ground_near
from planner.cover import best_cover
from planner.driver import Driver
from planner.driver_config import DriverConfig
from planner.frames import CostPatch, Decision, Percept, Status
from planner.methods.dwa import GROUND_REACH
from planner.observation import in_body_frame, observe
from planner.route import Route, least_cost_route
from scenes.pose import Pose

POLICY = Path(__file__).parents[1] / "policies" / "covernav_paper.safetensors"

CELLS, MIDDLE = 40, 19.5
"""Cells of the cost map a side, and where the robot stands in it, a row and a column."""


@dataclass(frozen=True)
class PaperConfig:
    """Metres and seconds.

    square : the waypoint lies on the side toward the goal of a square of this radius
    direct : goals nearer than this are planned to themselves
    look_ahead : how far along the route the window is sent; as published, it is sent to the waypoint at once,
        and cuts the corners on the way
    blocked : what stands as near to a cell bars it: TERP's elevation holds it, ours the bare ground alone
    attention : whether the network has a say in the cost map; without, steepness alone makes it
    cbam : whether its features pass the attention module before they are read; it was trained with it
    literal : the cost map as published, with its traps, see `planner.attention_cost`
    """

    square: float = 4.0
    direct: float = 10.0
    look_ahead: float = 2.0
    blocked: float = 0.5
    replan_period: float = 0.4
    attention: bool = True
    cbam: bool = True
    literal: bool = False
    cost: CostConfig = field(default_factory=CostConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)


@dataclass(frozen=True)
class _Plan:
    """Made at `time_s`: a route as world points (k, 2), and the cost map for drawing."""

    time_s: float
    points: np.ndarray
    patch: CostPatch


class CoverNavPaper:
    """Drives by weights from `covernav train`. Raises PolicyError where they cannot be used.

    policy : which weights
    """

    name = "covernav_paper"

    def __init__(self, weights: Path = POLICY, config: PaperConfig | None = None):
        self.config = config or PaperConfig()
        self._weights = weights
        self.driver = Driver(self.config.driver)
        self._plan: _Plan | None = None
        self._load()

    def _load(self) -> None:
        self._actor, self.policy = load_policy(self._weights)
        torch.set_num_threads(1)

    def reset(self) -> None:
        self.driver.reset()
        self._plan = None

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_actor", "policy")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load()

    def decide(self, percept: Percept) -> Decision:
        plan = self._plan
        if plan is None or percept.time_s - plan.time_s >= self.config.replan_period - 1e-6:
            plan = self._plan = self._make_plan(percept)
        waypoint = self._waypoint(percept, plan.points)
        ground = ground_near(percept.grid, percept.pose.x, percept.pose.y, GROUND_REACH, self.config.cost)
        driven = self.driver.drive(percept, waypoint, ground)
        return Decision(
            driven.command, waypoint, plan.points, plan.patch, driven.arcs,
            cover_id=best_cover(percept),
            note=driven.note, failure=Status.STUCK if driven.stuck else None,
        )  # fmt: skip

    @torch.inference_mode()
    def cost(self, percept: Percept) -> np.ndarray:
        """(40, 40) float32, body frame: 0 to 80, or 1000 where barred."""
        layers = observe(percept)["layers"]
        read = torch.from_numpy(layers[None, : self._actor.architecture.channels])
        encoder = self._actor.encoder
        attended = (encoder.attend(read) if self.config.cbam else encoder.features(read))[0].numpy()
        if not self.config.attention:
            attended = np.ones_like(attended)
        cost = cost_map(attended, percept.elevation_patch, self.config.literal)
        points = in_body_frame(percept.pose, percept.obstacle_points)
        for ahead, left in points:
            _bar(cost, ahead, left, self.config.blocked)
        return cost

    def _make_plan(self, percept: Percept) -> _Plan:
        cost = self.cost(percept)
        ahead, left = in_body_frame(percept.pose, np.array([percept.goal]))[0]
        goal = (left / PATCH_RESOLUTION + MIDDLE, ahead / PATCH_RESOLUTION + MIDDLE)
        route = self._route(1.0 + cost.astype(float), goal, percept.goal_distance)
        body = (route.cells[:, ::-1] - MIDDLE) * PATCH_RESOLUTION
        return _Plan(percept.time_s, _in_world(percept.pose, body[1:]), _drawn(percept.pose, cost))

    def _route(self, cost: np.ndarray, goal: tuple[float, float], distance: float) -> Route:
        start = round(MIDDLE), round(MIDDLE)
        if distance < self.config.direct:
            return least_cost_route(cost, PATCH_RESOLUTION, start, goal)
        reach = round(self.config.square / PATCH_RESOLUTION)
        low, high = start[0] - reach, start[0] + reach
        square = cost[low : high + 1, low : high + 1].copy()
        aim = np.array(goal) - MIDDLE
        facing = np.zeros(square.shape, bool)
        side = -1 if aim[np.argmax(np.abs(aim))] > 0.0 else 0
        facing[(side, slice(None)) if abs(aim[0]) > abs(aim[1]) else (slice(None), side)] = True
        rim = np.ones(square.shape, bool)
        rim[1:-1, 1:-1] = False
        square[rim & ~facing] = np.inf
        route = least_cost_route(square, PATCH_RESOLUTION, (reach, reach), (goal[0] - low, goal[1] - low))
        return Route(route.cells + low, route.cost)

    def _waypoint(self, percept: Percept, points: np.ndarray) -> tuple[float, float]:
        """A place on the route a little ahead of the robot, or the goal."""
        here = np.array([percept.pose.x, percept.pose.y])
        if not len(points) or percept.goal_distance <= PATCH_RESOLUTION:
            return percept.goal
        rest = points[int(np.argmin(np.hypot(*(points - here).T))) :]
        lengths = np.cumsum(np.hypot(*np.diff(np.vstack([here, rest]), axis=0).T))
        index = int(np.searchsorted(lengths, self.config.look_ahead))
        near = percept.goal_distance < self.config.direct
        if index >= len(rest) - 1 and near:
            return percept.goal
        x, y = rest[min(index, len(rest) - 1)]
        return float(x), float(y)


def _bar(cost: np.ndarray, ahead: float, left: float, reach: float) -> None:
    """Bar the cells whose centres are within `reach` of a point in the body frame."""
    row, col = left / PATCH_RESOLUTION + MIDDLE, ahead / PATCH_RESOLUTION + MIDDLE
    cells = reach / PATCH_RESOLUTION
    for r in range(max(math.ceil(row - cells), 0), min(math.floor(row + cells), CELLS - 1) + 1):
        for c in range(max(math.ceil(col - cells), 0), min(math.floor(col + cells), CELLS - 1) + 1):
            if math.hypot(r - row, c - col) <= cells:
                cost[r, c] = IMPASSABLE


def _in_world(pose: Pose, body: np.ndarray) -> np.ndarray:
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return body @ np.array([[cos, sin], [-sin, cos]]) + (pose.x, pose.y)


def _drawn(pose: Pose, cost: np.ndarray) -> CostPatch:
    """The cost map turned to lie along the world's axes; NaN beyond it."""
    along = (np.arange(CELLS) - MIDDLE) * PATCH_RESOLUTION
    east, north = np.meshgrid(pose.x + along, pose.y + along)
    body = in_body_frame(pose, np.column_stack([east.ravel(), north.ravel()]))
    col, row = np.rint(body / PATCH_RESOLUTION + MIDDLE).astype(int).T
    inside = (row >= 0) & (row < CELLS) & (col >= 0) & (col < CELLS)
    turned = np.full(CELLS * CELLS, np.nan, np.float32)
    turned[inside] = cost[row[inside], col[inside]]
    turned[turned >= IMPASSABLE] = np.inf
    return CostPatch(float(east[0, 0]), float(north[0, 0]), PATCH_RESOLUTION, turned.reshape(CELLS, CELLS))
