"""The bench of covert routes: how long they take, and that they are the best there are."""

from __future__ import annotations

import heapq
import math

import numpy as np

from app.bench.measure import Result, faster, milliseconds
from planner.covert_kernel import search
from planner.covert_route import CovertPlanner
from planner.space_time import SpaceTimePlanner
from scenes.families import generate
from scenes.scenario import Family, Observer, Patrol, Point, Scenario

CELLS, RESOLUTION = 256, 0.25
SEED, GOAL_DISTANCE = 5, 30.0
REPEATS = 5
WEIGHT = 0.9
SMALL_GRIDS = 40
ROUTE_BUDGET_MS, SPACE_TIME_BUDGET_MS = 150.0, 2000.0


def covert_route() -> Result:
    """A route over 256 × 256 cells from the exposure field to its figures, four observers."""
    scenario = _scenario()
    planner, start, goal = _planner(scenario)
    planner.route(start, goal, WEIGHT)
    ours = float(
        np.median([milliseconds(lambda: planner.route(start, goal, WEIGHT)) for _ in range(REPEATS)])
    )
    same = sum(_as_exhaustive(seed) for seed in range(SMALL_GRIDS))
    return faster(
        "covert_route",
        ours,
        ROUTE_BUDGET_MS,
        "the 150 ms that a route may take",
        f"least-exposure routes cost what the cheapest of all simple ways does on {same} of {SMALL_GRIDS} "
        "small grids",
    )


def space_time() -> Result:
    """A plan against the clock on the same map, four patrols; fields of view over time among the work."""
    scenario = _scenario()
    observers = tuple(_patrolling(observer) for observer in scenario.observers)
    planner, start, goal = _planner(scenario.revised(observers=observers))
    planner.route(start, goal, 0.0)
    SpaceTimePlanner(planner).route(start, goal, WEIGHT)
    ours = float(
        np.median(
            [milliseconds(lambda: SpaceTimePlanner(planner).route(start, goal, WEIGHT)) for _ in range(3)]
        )
    )
    moments = [SpaceTimePlanner(planner, time_s) for time_s in (0.0, 7.0, 19.0)]
    margins = [
        moment.best_static(start, goal, WEIGHT)[0] / moment.route(start, goal, WEIGHT).cost
        for moment in moments
    ]
    kept = sum(margin >= 1.0 - 1e-9 for margin in margins)
    return faster(
        "space_time",
        ours,
        SPACE_TIME_BUDGET_MS,
        "the 2 s that a plan may take",
        f"at {kept} of {len(moments)} moments of the beats no dearer than the best static way"
        f" (that one costs {', '.join(_times_as_much(margin) for margin in margins)})",
    )


def _times_as_much(margin: float) -> str:
    return f"{margin:.2f} ×" if math.isfinite(margin) else "more time than there is"


def _scenario() -> Scenario:
    return generate(
        Family.LOW_HIGH,
        SEED,
        size_m=(CELLS - 1) * RESOLUTION,
        resolution=RESOLUTION,
        goal_distance=GOAL_DISTANCE,
        observers=4,
    )


def _planner(scenario: Scenario) -> tuple[CovertPlanner, tuple[float, float], tuple[float, float]]:
    planner = CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers)
    return planner, (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)


def _patrolling(observer: Observer) -> Observer:
    """The same observer on a beat toward the middle of the map and back."""
    beat = Patrol(waypoints=(Point(x=0.3 * observer.x, y=0.3 * observer.y),), speed=1.2)
    return observer.model_copy(update={"patrol": beat})


def _as_exhaustive(seed: int) -> bool:
    """Whether the search finds the cheapest of all simple ways over a grid of 3 × 4 cells."""
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.01, 3.0, (4, 3, 4))
    cost[:, rng.random((3, 4)) < 0.15] = np.inf
    cost[:, 0, 0] = cost[:, 2, 3] = 0.5
    _, best = search(cost, 1.0, 0, 11)
    known = _cheapest_way(cost)
    return bool(best[11] == known or math.isclose(best[11], known, rel_tol=1e-12))


def _cheapest_way(cost: np.ndarray) -> float:
    """Cost of the cheapest way without a repeated cell from the first cell to the last, all of them tried."""
    _, rows, cols = cost.shape
    least = math.inf
    open_ways: list[tuple[float, tuple[int, ...]]] = [(0.0, (0,))]
    while open_ways:
        so_far, way = heapq.heappop(open_ways)
        row, col = divmod(way[-1], cols)
        if way[-1] == rows * cols - 1:
            least = min(least, so_far)
            continue
        for dr, dc in ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)):
            r, c = row + dr, col + dc
            there = r * cols + c
            if not (0 <= r < rows and 0 <= c < cols) or there in way:
                continue
            axis = {(0, 1): 0, (1, 1): 1, (1, 0): 2, (1, -1): 3}[max((dr, dc), (-dr, -dc))]
            mean = 0.5 * (cost[axis, row, col] + cost[axis, r, c])
            if math.isfinite(mean):
                heapq.heappush(open_ways, (so_far + mean * math.hypot(dr, dc), (*way, there)))
    return least
