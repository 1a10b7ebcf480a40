"""CoverNav as this project plans it: least-cost routes over the robot's own map with exposure among the
costs, driven by the dynamic window."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from planner.braking import LevelBraking
from planner.cost_map import CostMap
from planner.encounters import meeting_chance
from planner.foresight import Foresight, straight_on
from planner.frames import CostPatch, Decision, Percept, Perception
from planner.hull_exposure import hull_exposure
from planner.methods.least_cost import ASTRAY, LeastCost, LeastCostConfig, Plan
from planner.pace import Pace
from planner.route import Route, least_cost_route, route_cost
from planner.sensed_exposure import exposure_on_arrival, sensed_exposure
from scenes.rays import RayScene
from scenes.scenario import Observer, Scenario

CHORD = 7
"""Cells of a route that one straight line stands for when its length is taken."""


@dataclass(frozen=True)
class CoverNavConfig:
    """weights : metres of hidden way that a metre in full view at full speed is worth, of the routes tried at
        first; later ones are tried `nearby` times the one whose route was taken, at most the `greatest`, and
        as little of it
    halvings : of the weights between the greatest whose route is short enough and one whose route is not
    longest : how many times as long as the shortest way the whole drive may be when it sets off, a little
        more than the bound's twice, for the map's ways are longer; a detour that is left of it is never less
        than `detour` times the shortest way from here
    slack : metres that a way begun may turn out longer
    length_share : metres in full view that a metre of way counts as, between routes
    failure : metres in full view that a metre counts as where a drive has failed
    meeting : and where it would surely meet somebody who walks or drives about
    loyalty : metres in full view, and share of those ahead, that another route must spare to replace the
        present one: what the map tells changes as it grows, and a robot that follows every change dithers
    drawn : points, of 0..100, that full view has in the cost map that is drawn
    cover : whether it heeds what the camera tells of cover; without, the map's word alone counts
    pace : how fast the robot goes beside obstacles
    """

    weights: tuple[float, ...] = (2.0, 6.0, 15.0, 40.0)
    nearby: float = 1.7
    greatest: float = 100.0
    halvings: int = 2
    longest: float = 2.05
    slack: float = 1.5
    detour: float = 1.2
    length_share: float = 0.03
    failure: float = 8.0
    meeting: float = 8.0
    loyalty: tuple[float, float] = (0.5, 0.2)
    drawn: float = 50.0
    cover: bool = True
    pace: Pace = field(default_factory=Pace)
    planner: LeastCostConfig = field(default_factory=lambda: LeastCostConfig(look_ahead=1.4))


class CoverNav(LeastCost):
    """Of the routes for several weights of exposure it takes the least exposed that is not too long.

    weights : of a network that has learnt how people and vehicles go on (`planner.habits`), or of one that
        corrects what its map tells of its exposure (`planner.exposure_network`). Raises PolicyError for a
        file of neither
    foresight : where those who walk or drive about go on to, where there is no network for that
    """

    name = "covernav"

    def __init__(
        self,
        config: CoverNavConfig | None = None,
        weights: Path | None = None,
        foresight: Foresight = straight_on,
    ):
        self.covert = config or CoverNavConfig()
        self._network, self._foresight = None, foresight
        super().__init__(self.covert.planner)
        self.driver.stopping = LevelBraking()
        if weights is not None:
            self._learn_from(weights)
        self._scenario: Scenario | None = None
        self._rays: RayScene | None = None
        self._true: tuple[tuple[Observer, ...], np.ndarray] | None = None
        self._forget()

    def _learn_from(self, weights: Path) -> None:
        # Torch is for those who have learnt.
        from planner.checkpoint import PolicyError, read_tensors
        from planner.exposure_network import ARCHITECTURE as EXPOSURE
        from planner.exposure_network import load_network
        from planner.habits import ARCHITECTURE as HABITS
        from planner.habits import load_habits

        _, about, _ = read_tensors(weights)
        kind = about.get("architecture")
        if kind == HABITS:
            self._foresight, self.policy = load_habits(weights)
        elif kind == EXPOSURE:
            self._network, self.policy = load_network(weights)
        else:
            raise PolicyError(
                f"{weights} holds weights of the architecture {kind or 'none that it names'};"
                f" covernav takes {HABITS} and {EXPOSURE}"
            )

    def brief(self, scenario: Scenario, rays: RayScene) -> None:
        """Take over the truth, which is looked at where the perception is the oracle's alone."""
        self._scenario, self._rays, self._true = scenario, rays, None

    def reset(self) -> None:
        super().reset()
        self._forget()

    def _forget(self) -> None:
        self._begun_m: float | None = None
        self._driven, self._last = 0.0, None
        self._terms: _Terms | None = None
        self._weight: float | None = None

    def decide(self, percept: Percept) -> Decision:
        here = (percept.pose.x, percept.pose.y)
        if self._last is not None:
            self._driven += math.dist(here, self._last)
        self._last = here
        return super().decide(percept)

    def __getstate__(self):
        return self.__dict__ | {"_rays": None, "_scenario": None, "_true": None}

    def _find_route(
        self,
        percept: Percept,
        cost_map: CostMap,
        cost: np.ndarray,
        start: tuple[int, int],
        goal: tuple[float, float],
    ) -> tuple[Route, np.ndarray, CostPatch]:
        met = self._meeting(percept)
        cost = cost + met
        best = shortest = least_cost_route(cost, cost_map.resolution, start, goal)
        seen = self._exposure(percept)
        patch = _with_exposure(cost_map, self.covert.drawn * seen)
        self._terms = None
        if not shortest.found or not seen.any() or not self.covert.weights:
            return shortest, cost, patch
        length = _length(cost_map, shortest.cells, percept.goal)
        if self._begun_m is None:
            self._begun_m = length
        allowed = max(self.covert.longest * self._begun_m - self._driven, self.covert.detour * length)
        # Seconds in view count, and beside obstacles the robot is slow.
        pace = self.covert.pace
        in_view = seen * (pace.cruise / pace.speed(cost_map.clearance))
        toll = in_view + met + self.covert.failure * cost_map.layers.get("shunned", 0.0) / 100.0
        self._terms = terms = _Terms(cost_map, toll, allowed, percept.goal, self.covert.length_share)
        # Were only the exposure to grow dear, the way would hug obstacles that the dynamic window keeps off.
        bad = toll + np.minimum(cost_map.total, 100.0) / 100.0
        best, best_cost, least = shortest, cost, terms.burden(shortest.cells)
        low, high, tries = 0.5, math.inf, self._tries()
        while tries:
            weight = tries.pop(0)
            dearer = cost + weight * bad
            route = least_cost_route(dearer, cost_map.resolution, start, goal)
            if not route.found or _length(cost_map, route.cells, percept.goal) > allowed:
                first, high = math.isinf(high), weight
                tries = self.covert.halvings * [0.0] if first else tries
            else:
                low = max(low, weight)
                burden = terms.burden(route.cells)
                if burden < least:
                    best, best_cost, least, self._weight = route, dearer, burden, weight
            if tries and math.isfinite(high):
                tries[0] = math.sqrt(low * high)
        return best, best_cost, patch

    def _tries(self) -> list[float]:
        """Weights, ascending: all at first, then those about the one whose route was taken last."""
        if self._weight is None:
            return list(self.covert.weights)
        nearby = (self._weight / self.covert.nearby, self._weight, self._weight * self.covert.nearby)
        return sorted({float(np.clip(w, self.covert.weights[0], self.covert.greatest)) for w in nearby})

    def _keep_old(self, percept: Percept, plan: Plan, route: Route) -> Plan:
        """Along the old route unless the new one spares enough."""
        old, terms = self._plan, self._terms
        if terms is None or old is None or not len(old.points) or not route.found:
            return super()._keep_old(percept, plan, route)
        rest = self._rest_of_route(percept, old)
        cells = np.rint(plan.grid_points(rest)).astype(int)
        if (cells < 0).any() or (cells >= plan.cost.shape).any():
            return plan
        off_route = math.dist(rest[0], (percept.pose.x, percept.pose.y))
        behind = _to_go(plan.map, cells, percept.goal) - _to_go(plan.map, route.cells, percept.goal)
        cost = self._lenient(plan)
        free = math.isfinite(route_cost(cost, plan.map.resolution, cells))
        if not free or off_route > ASTRAY or behind > ASTRAY or not terms.allow(cells, self.covert.slack):
            return plan
        least, share = self.covert.loyalty
        burden = terms.burden(cells)
        if burden - terms.burden(route.cells) > max(least, share * burden):
            return plan
        return replace(plan, cost=cost, points=rest, reason="")

    def _meeting(self, percept: Percept) -> np.ndarray | float:
        """(rows, cols) metres that a metre counts as for whom the robot may meet there; what is hardly likely
        counts less than its chance, or the many ways that somebody may go would close every way."""
        if not self.covert.meeting or not percept.moving:
            return 0.0
        return self.covert.meeting * meeting_chance(percept, self._foresight) ** 2

    def _exposure(self, percept: Percept) -> np.ndarray:
        """(rows, cols) float32 visible fraction over the percept's grid."""
        if percept.perception is Perception.ORACLE and self._scenario is not None and self._rays is not None:
            return self._true_exposure(percept, self._scenario, self._rays)
        if not self.covert.cover:
            percept = replace(percept, cover=())
        if self._network is None:
            return exposure_on_arrival(percept)
        from planner.exposure_network import corrected_exposure

        return corrected_exposure(self._network, percept, sensed_exposure(percept))

    def _true_exposure(self, percept: Percept, scenario: Scenario, rays: RayScene) -> np.ndarray:
        heightmap, grid = scenario.terrain.heightmap(), percept.grid
        if self._true is None or self._true[0] != percept.observers:
            self._true = percept.observers, hull_exposure(rays, heightmap, percept.observers).anywhere
        fraction = self._true[1]
        x, y = (start + grid.resolution * np.arange(size) for start, size in (
            (grid.x_min, grid.shape[1]), (grid.y_min, grid.shape[0]))
        )  # fmt: skip
        row, col = heightmap.cells(*np.meshgrid(x, y))
        return fraction[row, col]


def _with_exposure(cost_map: CostMap, points: np.ndarray) -> CostPatch:
    patch = cost_map.patch()
    return CostPatch(patch.x_min, patch.y_min, patch.resolution, np.minimum(patch.cost + points, 100.0))


@dataclass(frozen=True, eq=False)
class _Terms:
    """What routes over a map are compared on.

    toll : (rows, cols) metres in full view at full speed that a metre here counts as
    allowed : metres that a route may be long; length_share : as in the configuration
    """

    map: CostMap
    toll: np.ndarray
    allowed: float
    goal: tuple[float, float]
    length_share: float

    def allow(self, cells: np.ndarray, slack: float) -> bool:
        """Whether the way along cells (k, 2) is at most `slack` metres too long."""
        return _length(self.map, cells, self.goal) <= self.allowed + slack

    def burden(self, cells: np.ndarray) -> float:
        """Metres in view along cells (k, 2), and the share of their length that counts beside."""
        toll = route_cost(self.toll, self.map.resolution, cells)
        return toll + self.length_share * _length(self.map, cells, self.goal)


def _length(cost_map: CostMap, cells: np.ndarray, goal: tuple[float, float]) -> float:
    """Metres along cells (k, 2) by their chords, for the robot cuts the corners of the grid's eight ways, and
    straight on to a goal that lies off the map."""
    corners = np.concatenate([cells[:-1:CHORD], cells[-1:]])
    steps = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    return cost_map.resolution * steps + _to_go(cost_map, cells, goal)


def _to_go(cost_map: CostMap, cells: np.ndarray, goal: tuple[float, float]) -> float:
    return math.dist(cost_map.centre(*cells[-1]), goal)
