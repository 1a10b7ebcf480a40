"""The missions that methods are compared on: seeded, reachable, with what the best routes would be seen.

`random` takes generated scenes as they come. `covert` keeps those in which cover matters: the shortest
route is seen at least a quarter of its time, and a route of at most twice its length has at most three
fifths of its exposed seconds. `crossing` is random ground on which people and vehicles cross the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import lru_cache
from itertools import islice

import numpy as np

from planner.covert_route import LONGEST, CovertPlanner, CovertRoute
from planner.no_route import NoRoute
from planner.posting import Placement, post_watchers, watching_groups
from scenes.crossings import crossing_scenario
from scenes.families import generate
from scenes.rays import RayScene
from scenes.scenario import Family, Scenario, ScenarioError
from scenes.stage import Stage

LEAST_SEEN = 0.25
MOST_LEFT = 0.6
LONGEST_SHORTEST = 1.5
"""How many times as long as the straight line the shortest way may be, for twice that to fit the time."""

ATTEMPTS, TRIES = 40, 2
SURELY = 0.1  # by how much the guess at a group of watchers must do better


class Suite(StrEnum):
    RANDOM = "random"
    COVERT = "covert"
    CROSSING = "crossing"


class Knowledge(StrEnum):
    """Whether the robot knows of the observers from the start or has to find them."""

    KNOWN = "known"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Reference:
    """What the route engine makes of a mission; lengths in metres, all None where it finds no way.

    shortest_s, bound_s : exposed seconds of the shortest route, and least of any of at most twice its length
    """

    shortest_m: float | None = None
    shortest_s: float | None = None
    bound_m: float | None = None
    bound_s: float | None = None


@dataclass(frozen=True, eq=False)
class SuiteMission:
    """rays : of its ground and cover
    stage : its physics, for drives one after another
    """

    scenario: Scenario
    reference: Reference
    rays: RayScene
    stage: Stage = field(default_factory=Stage)


@lru_cache(maxsize=2)
def suite_mission(
    suite: Suite,
    terrain: Family,
    seed: int,
    knowledge: Knowledge,
    goal_distance: float,
    placement: Placement = Placement.UNIFORM,
) -> SuiteMission:
    """The mission of a seed; the same arguments give the same one. `uniform` leaves a random scene the
    observers that it came with.

    Raises ScenarioError where the terrain gives none.
    """
    size = size_for(goal_distance)
    if suite is not Suite.COVERT:
        make = crossing_scenario if suite is Suite.CROSSING else generate
        scenario = make(terrain, seed, size_m=size, goal_distance=goal_distance)
        if placement is Placement.VANTAGE:
            scenario = _watched(scenario, seed)
        found = _as_it_comes(scenario)
    else:
        found = _covert(terrain, seed, size, goal_distance, placement)
    if knowledge is Knowledge.KNOWN:
        return found
    hidden = tuple(observer.model_copy(update={"known": False}) for observer in found.scenario.observers)
    return replace(found, scenario=found.scenario.revised(observers=hidden))


def size_for(goal_distance: float) -> float:
    """Side of the square map in metres: room for the drive and a detour around it."""
    return max(48.0, 1.6 * goal_distance)


def _watched(scenario: Scenario, seed: int) -> Scenario:
    """With as many observers as it came with, where watchers would stand."""
    planner = _planner(scenario.revised(observers=()))
    start, goal, _ = _ends(scenario)
    rng = np.random.default_rng([seed, 78])
    posted = post_watchers(rng, planner, start, goal, len(scenario.observers), Placement.VANTAGE)
    return scenario.revised(observers=posted)


def _as_it_comes(scenario: Scenario) -> SuiteMission:
    start, goal, yaw = _ends(scenario)
    planner = _planner(scenario)
    try:
        shortest, bound = planner.route(start, goal, 0.0, yaw), planner.bound(start, goal, yaw=yaw)
    except NoRoute:
        return SuiteMission(scenario, Reference(), planner.rays)
    return SuiteMission(scenario, _reference(shortest, bound), planner.rays)


def _covert(
    terrain: Family, seed: int, size: float, goal_distance: float, placement: Placement
) -> SuiteMission:
    rng = np.random.default_rng([seed, list(Family).index(terrain), 77])
    for attempt in range(ATTEMPTS):
        land = seed if attempt == 0 else int(rng.integers(2**31))
        scenario = generate(terrain, land, size_m=size, goal_distance=goal_distance, observers=0)
        planner = _planner(scenario)
        start, goal, _ = _ends(scenario)
        try:
            groups = watching_groups(
                rng, planner, start, goal, LEAST_SEEN + SURELY, MOST_LEFT - SURELY, placement
            )
            for observers in islice(groups, TRIES):
                name = f"covert {terrain.value} {seed}"
                found = _judge(scenario.revised(observers=observers, name=name), planner.rays)
                if found is not None:
                    return found
        except NoRoute:
            continue
    raise ScenarioError(
        f"seed {seed} of {terrain.value} gives no mission in which cover matters in {ATTEMPTS} attempts;"
        " take another seed"
    )


def _judge(scenario: Scenario, rays: RayScene) -> SuiteMission | None:
    """The mission, if cover matters in it."""
    start, goal, yaw = _ends(scenario)
    planner = _planner(scenario, rays)
    shortest, hidden = planner.route(start, goal, 0.0, yaw), planner.bound(start, goal, yaw=yaw)
    if (
        shortest.length_m > LONGEST_SHORTEST * math.dist(start, goal)
        or shortest.exposure_fraction < LEAST_SEEN
        or hidden.exposed_s > MOST_LEFT * shortest.exposed_s
        or hidden.length_m > LONGEST * shortest.length_m
    ):
        return None
    return SuiteMission(scenario, _reference(shortest, hidden), rays)


def _planner(scenario: Scenario, rays: RayScene | None = None) -> CovertPlanner:
    return CovertPlanner(scenario.terrain.heightmap(), scenario.cover, scenario.observers, rays)


def _ends(scenario: Scenario) -> tuple[tuple[float, float], tuple[float, float], float]:
    start, goal = scenario.start, scenario.goal
    return (start.x, start.y), (goal.x, goal.y), math.radians(start.yaw)


def _reference(shortest: CovertRoute, bound: CovertRoute) -> Reference:
    return Reference(shortest.length_m, shortest.exposed_s, bound.length_m, bound.exposed_s)
