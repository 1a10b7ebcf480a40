"""The paper's four terrains, generated from a seed. A new family is one entry in `RECIPES`."""

from __future__ import annotations

import math

import numpy as np

from scenes.catalogue import CoverKind
from scenes.landscape import ENDS_FROM_EDGE, Landscape, Recipe
from scenes.placement import place_observers, within_half_turn
from scenes.scenario import Family, GeneratedSource, Point, Scenario, ScenarioError, Start, Terrain
from scenes.terrain import MAX_CELLS, Surface
from scenes.traversability import reachable

PASSAGE = 1.2
MIN_GOAL_DISTANCE = 3.0
MIN_SIZE = 12.0
RESOLUTION = 0.25
MAX_SIZE = (MAX_CELLS - 1) * RESOLUTION
"""Metres a side at the usual resolution."""
MAX_OBSERVERS = 20
MAX_ATTEMPTS = 60
TREE, BUSH, ROCK, COTTAGE, BUILDING, HOUSE, WRECK, FENCE = CoverKind

RECIPES: dict[Family, Recipe] = {
    Family.NORMAL: Recipe(
        hills=(0.2, 0.6), longest=30.0, shortest=5.0, tilt=2.5, relief=(0.1, 5.0), roughness=0.02,
        way=(Surface.TRAIL, Surface.GRAVEL), way_width=2.2, way_by_route=0.3,
        building_kinds=(COTTAGE, HOUSE), buildings=(0, 1), fences=(0, 1), ponds=(0, 1),
        density={TREE: 5.0, BUSH: 8.0, ROCK: 4.0, WRECK: 0.3},
        route_kinds=(BUSH, ROCK, TREE, WRECK), on_route=(2, 3),
    ),
    Family.LOW: Recipe(
        hills=(0.5, 0.9), longest=22.0, shortest=4.0, tilt=0.3, relief=(0.3, 0.95), roughness=0.03,
        way=(Surface.GRAVEL, Surface.ASPHALT), way_width=2.8, way_by_route=0.3,
        building_kinds=(HOUSE, COTTAGE, BUILDING), buildings=(2, 3), fences=(2, 4), ponds=(0, 0),
        density={TREE: 4.0, BUSH: 6.0, ROCK: 3.0, WRECK: 0.7},
        route_kinds=(FENCE, WRECK, BUSH, ROCK), on_route=(2, 3),
    ),
    Family.LOW_HIGH: Recipe(
        hills=(1.6, 2.8), longest=24.0, shortest=5.0, tilt=1.0, relief=(1.4, 2.9), roughness=0.04,
        way=(Surface.TRAIL,), way_width=1.8, way_by_route=0.5,
        building_kinds=(COTTAGE,), buildings=(0, 1), fences=(0, 2), ponds=(0, 1),
        density={TREE: 10.0, BUSH: 13.0, ROCK: 8.0, WRECK: 0.2},
        route_kinds=(BUSH, ROCK, TREE), on_route=(2, 4),
    ),
    Family.FOREST: Recipe(
        hills=(4.4, 5.8), longest=30.0, shortest=7.0, tilt=1.0, relief=(4.2, 6.5), roughness=0.05,
        way=(Surface.TRAIL,), way_width=1.8, way_by_route=0.8,
        building_kinds=(COTTAGE,), buildings=(0, 1), fences=(0, 0), ponds=(1, 2),
        density={TREE: 46.0, BUSH: 26.0, ROCK: 8.0},
        route_kinds=(TREE, BUSH, ROCK), on_route=(2, 4),
    ),
}  # fmt: skip


def generate(
    family: Family | str,
    seed: int,
    *,
    size_m: float = 48.0,
    resolution: float = RESOLUTION,
    goal_distance: float = 12.0,
    observers: int = 1,
) -> Scenario:
    """A scenario of the family; the same arguments give the same document.

    size_m : side of the square map in metres; resolution : metres between samples
    goal_distance : straight line from start to goal; a way with `PASSAGE` metres of room joins them
    Raises ScenarioError where the distance does not fit the map or an argument is out of range.
    """
    family = _checked(family, seed, size_m, resolution, goal_distance, observers)
    for attempt in range(MAX_ATTEMPTS):
        rng = np.random.default_rng([seed, list(Family).index(family), attempt])
        land = Landscape(rng, RECIPES[family], size_m, resolution, goal_distance)
        if land.ends_are_gentle() and reachable(
            land.ground, land.cover, *land.route, clearance=0.5 * PASSAGE
        ):
            return _document(rng, land, family, seed, observers)
    raise ScenarioError(
        f"seed {seed} of {family.value} gives no reachable goal {goal_distance:g} m away on a map of"
        f" {size_m:g} m in {MAX_ATTEMPTS} attempts; take a larger map or another seed"
    )


def _checked(
    family: Family | str, seed: int, size_m: float, resolution: float, goal_distance: float, observers: int
) -> Family:
    try:
        family = Family(family)
    except ValueError:
        raise ScenarioError(f"terrain {family!r} is none of {', '.join(Family)}") from None
    if not 0.05 <= resolution <= 1.0:
        raise ScenarioError(f"resolution is {resolution:g} m; it must be 0.05 to 1 m")
    largest = (MAX_CELLS - 1) * resolution
    for name, value, unit, low, high in (
        ("seed", seed, "", 0, 2**63 - 1),
        ("size", size_m, f" m at {resolution:g} m a cell", MIN_SIZE, largest),
        (
            "goal distance",
            goal_distance,
            f" m on a map of {size_m:g} m",
            MIN_GOAL_DISTANCE,
            size_m - 2 * ENDS_FROM_EDGE,
        ),
        ("number of observers", observers, "", 0, MAX_OBSERVERS),
    ):
        if not low <= value <= high:
            raise ScenarioError(f"{name} is {value:g}{unit}; it must be {low:g} to {high:g}")
    return family


def _document(
    rng: np.random.Generator, land: Landscape, family: Family, seed: int, observers: int
) -> Scenario:
    (x, y), (goal_x, goal_y) = land.route
    spread = 45.0 if rng.random() < 0.85 else 120.0
    yaw = math.degrees(math.atan2(goal_y - y, goal_x - x)) + rng.uniform(-spread, spread)
    return Scenario(
        version=1,
        name=f"{family.value} {seed}",
        description=f"Generated {family.value.replace('_', '-')} terrain, seed {seed}.",
        terrain=Terrain(
            resolution=land.ground.resolution,
            heights=land.ground.heights,
            surface=land.ground.surface_symbols(),
            source=GeneratedSource(family=family, seed=seed),
        ),
        start=Start(x=x, y=y, yaw=within_half_turn(yaw)),
        goal=Point(x=goal_x, y=goal_y),
        cover=tuple(land.cover),
        observers=place_observers(rng, land.ground, land.cover, land.route, observers),
    )
