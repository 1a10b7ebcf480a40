"""The missions that methods are compared on: seeded, reachable, with what the best routes would be seen.

`random` takes generated scenes as they come. `covert` keeps those in which cover matters: the shortest route
is seen at least a quarter of its time, and a route of at most twice its length has at most three fifths of its
exposed seconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

from planner.covert_route import CovertConfig, CovertPlanner, CovertRoute, NoRoute
from planner.line_of_sight import View, views_at
from scenes.families import generate
from scenes.placement import room_to_watch, watcher
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Family, Observer, Scenario, ScenarioError

LEAST_SEEN = 0.25
MOST_LEFT = 0.6

CANDIDATES = 60
GROUPS = 40
TRIES = 3
ATTEMPTS = 30
COARSE_CELL = 0.5
COARSE_MARGIN = 0.1


class Suite(StrEnum):
    RANDOM = "random"
    COVERT = "covert"


class Knowledge(StrEnum):
    """Whether the robot knows of the observers from the start or has to find them."""

    KNOWN = "known"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Reference:
    """What the route engine makes of a mission; lengths in metres.

    shortest_s, bound_s : exposed seconds of the shortest route, and least of any of at most twice its length
    """

    shortest_m: float
    shortest_s: float
    bound_m: float
    bound_s: float


@dataclass(frozen=True, eq=False)
class SuiteMission:
    scenario: Scenario
    reference: Reference


@lru_cache(maxsize=16)
def suite_mission(
    suite: Suite, terrain: Family, seed: int, knowledge: Knowledge, goal_distance: float
) -> SuiteMission:
    """The mission of a seed; the same arguments give the same one.

    Raises ScenarioError where the terrain gives none.
    """
    size = size_for(goal_distance)
    if suite is Suite.RANDOM:
        scenario = generate(terrain, seed, size_m=size, goal_distance=goal_distance)
        found = SuiteMission(scenario, _reference(_planner(scenario), scenario))
    else:
        found = _covert(terrain, seed, size, goal_distance)
    if knowledge is Knowledge.KNOWN:
        return found
    hidden = tuple(
        observer.model_copy(update={"known": False}) for observer in found.scenario.observers
    )
    return SuiteMission(found.scenario.revised(observers=hidden), found.reference)


def size_for(goal_distance: float) -> float:
    """Side of the square map in metres: room for the drive and a detour around it."""
    return max(48.0, 1.6 * goal_distance)


def matters(reference: Reference, duration_s: float) -> bool:
    """Whether cover matters on a mission whose shortest route takes so many seconds."""
    return (
        reference.shortest_s >= LEAST_SEEN * duration_s
        and reference.bound_s <= MOST_LEFT * reference.shortest_s
    )


def _covert(terrain: Family, seed: int, size: float, goal_distance: float) -> SuiteMission:
    rng = np.random.default_rng([seed, list(Family).index(terrain), 77])
    for attempt in range(ATTEMPTS):
        land = seed if attempt == 0 else int(rng.integers(2**31))
        scenario = generate(terrain, land, size_m=size, goal_distance=goal_distance, observers=0)
        rays = RayScene(scenario.terrain.heightmap(), scenario.cover)
        for observers in _watchers(rng, scenario, rays):
            found = _judge(scenario.revised(observers=observers, name=f"covert {terrain.value} {seed}"), rays)
            if found is not None:
                return found
    raise ScenarioError(
        f"seed {seed} of {terrain.value} gives no mission in which cover matters in {ATTEMPTS} attempts;"
        " take another seed"
    )


def _judge(scenario: Scenario, rays: RayScene) -> SuiteMission | None:
    """The mission if cover matters in it, by coarse cells first."""
    rough = _planner(scenario, rays, CovertConfig(cell=COARSE_CELL))
    start, goal, yaw = _ends(scenario)
    try:
        shortest, hidden = (rough.route(start, goal, weight, yaw) for weight in (0.0, 0.9))
        if hidden.exposed_s > (MOST_LEFT + COARSE_MARGIN) * shortest.exposed_s:
            return None
        planner = _planner(scenario, rays)
        reference = _reference(planner, scenario)
        if matters(reference, planner.route(start, goal, 0.0, yaw).duration_s):
            return SuiteMission(scenario, reference)
    except NoRoute:
        pass
    return None


def _planner(
    scenario: Scenario, rays: RayScene | None = None, config: CovertConfig | None = None
) -> CovertPlanner:
    return CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers, rays, config)


def _ends(scenario: Scenario) -> tuple[tuple[float, float], tuple[float, float], float]:
    start, goal = scenario.start, scenario.goal
    return (start.x, start.y), (goal.x, goal.y), math.radians(start.yaw)


def _reference(planner: CovertPlanner, scenario: Scenario) -> Reference:
    start, goal, yaw = _ends(scenario)
    shortest = planner.route(start, goal, 0.0, yaw)
    bound = planner.bound(start, goal, yaw=yaw)
    return Reference(shortest.length_m, shortest.exposed_s, bound.length_m, bound.exposed_s)


def _watchers(
    rng: np.random.Generator, scenario: Scenario, rays: RayScene
) -> Iterator[tuple[Observer, ...]]:
    """Groups of one to three watchers who see the shortest route but leave somewhere else to go, best first."""
    planner = _planner(scenario, rays)
    start, goal, _ = _ends(scenario)
    try:
        shortest = planner.route(start, goal, 0.0)
    except NoRoute:
        return
    route = (start, goal)
    ground = planner.heightmap
    half = ground.bounds[1] - 1.0
    places = rng.uniform(-half, half, (8 * CANDIDATES, 2))
    places = places[room_to_watch(ground, scenario.cover, route, places)][:CANDIDATES]
    middle = 0.5 * np.sum(route, axis=0)
    candidates = [watcher(rng, 1, place, middle) for place in places]
    on_route = _lit(rays, views_at(candidates, ground, 0.0), _over(ground, _points_along(shortest)))
    around = _lit(rays, views_at(candidates, ground, 0.0), _over(ground, _points_around(rng, planner, route)))
    groups = []
    for _ in range(GROUPS if len(candidates) >= 3 else 0):
        group = rng.choice(len(candidates), int(rng.integers(1, 4)), replace=False)
        seen, beside = on_route[group].max(axis=0).mean(), around[group].max(axis=0).mean()
        if seen >= LEAST_SEEN + 0.05:
            groups.append((float(beside - seen), tuple(int(member) for member in group)))
    for _, group in sorted(groups)[:TRIES]:
        yield tuple(
            candidates[member].model_copy(update={"id": number}) for number, member in enumerate(group, 1)
        )


def _points_along(route: CovertRoute) -> np.ndarray:
    """(40, 2) places evenly along a route."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route.points, axis=0).T))])
    at = np.linspace(0.0, along[-1], 40)
    return np.column_stack([np.interp(at, along, route.points[:, axis]) for axis in (0, 1)])


def _points_around(rng: np.random.Generator, planner: CovertPlanner, route) -> np.ndarray:
    """(n, 2) drivable places that a way of not much more than the straight length may touch."""
    row, col = np.nonzero(~planner.costs.forbidden)
    points = planner.costs.centre(row, col)
    by_way = sum(np.hypot(*(points - end).T) for end in np.array(route))
    near = np.flatnonzero(by_way < 1.6 * math.dist(*route))
    return points[rng.choice(near, min(200, len(near)), replace=False)] if len(near) else points[:1]


def _over(ground, points: np.ndarray) -> np.ndarray:
    """(n, 3) the middle height of the robot's body over points (n, 2)."""
    return np.column_stack([points, ground.height_at(*points.T) + 0.5 * HUSKY.height])


def _lit(rays: RayScene, views: tuple[View, ...], points: np.ndarray) -> np.ndarray:
    """(views, n) share of light from points (n, 3) to each view."""
    light = np.zeros((len(views), len(points)))
    for row, view in zip(light, views, strict=True):
        held = view.holds(points)
        row[held] = rays.visible(view.eye, points[held])
    return light
