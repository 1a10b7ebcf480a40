"""The paper's four terrains, generated from a seed. A new family is one entry in `RECIPES`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from scenes.catalogue import CoverKind, Footprint
from scenes.placement import WALLED, Plot, Segment, distance_to_segment, draw, place_observers
from scenes.relief import Pond, Trail, distance_to, fractal, level_pad
from scenes.robot import HUSKY
from scenes.scenario import (
    CoverObject,
    Family,
    GeneratedSource,
    Point,
    Scenario,
    ScenarioError,
    Start,
    Terrain,
)
from scenes.terrain import MAX_CELLS, SURFACES, Heightmap, Surface
from scenes.traversability import reachable

PASSAGE = 1.2
ENDS_FROM_EDGE = 2.5
MIN_GOAL_DISTANCE = 3.0
MIN_SIZE = 12.0
MAX_ATTEMPTS = 60
GENTLE = math.radians(9.0)
TREE, BUSH, ROCK, COTTAGE, BUILDING, HOUSE, WRECK, FENCE = CoverKind


@dataclass(frozen=True)
class Recipe:
    """What a family is made of; lengths in metres.

    relief : lowest and highest share of ground between its bottom and top
    tilt : steepest inclination of the whole map, degrees
    longest, shortest : wavelengths of the hills
    roughness : height of the finest bumps, peak to peak
    way, way_width : surface of the path through the map
    buildings : kinds to draw from, fewest and most
    fences, ponds : fewest and most
    density : objects a 1000 m²
    on_route : kinds put between start and goal, so many for every 12 m, fewest and most
    """

    relief: tuple[float, float]
    tilt: float
    longest: float
    shortest: float
    roughness: float
    way: tuple[Surface, ...]
    way_width: float
    way_by_route: float
    buildings: tuple[tuple[CoverKind, ...], int, int]
    fences: tuple[int, int]
    ponds: tuple[int, int]
    density: Mapping[CoverKind, float]
    on_route: tuple[tuple[CoverKind, ...], int, int]


RECIPES: dict[Family, Recipe] = {
    Family.NORMAL: Recipe(
        relief=(0.2, 4.0), tilt=2.5, longest=30.0, shortest=5.0, roughness=0.02,
        way=(Surface.TRAIL, Surface.GRAVEL), way_width=2.2, way_by_route=0.3,
        buildings=((COTTAGE, HOUSE), 0, 1), fences=(0, 1), ponds=(0, 1),
        density={TREE: 5.0, BUSH: 8.0, ROCK: 4.0, WRECK: 0.3},
        on_route=((BUSH, ROCK, TREE, WRECK), 2, 3),
    ),
    Family.LOW: Recipe(
        relief=(0.5, 0.9), tilt=0.3, longest=22.0, shortest=4.0, roughness=0.03,
        way=(Surface.GRAVEL, Surface.ASPHALT), way_width=2.8, way_by_route=0.3,
        buildings=((HOUSE, COTTAGE, BUILDING), 2, 3), fences=(2, 4), ponds=(0, 0),
        density={TREE: 4.0, BUSH: 6.0, ROCK: 3.0, WRECK: 0.7},
        on_route=((FENCE, WRECK, BUSH, ROCK), 2, 3),
    ),
    Family.LOW_HIGH: Recipe(
        relief=(1.6, 2.8), tilt=1.5, longest=24.0, shortest=4.0, roughness=0.04,
        way=(Surface.TRAIL,), way_width=1.8, way_by_route=0.5,
        buildings=((COTTAGE,), 0, 1), fences=(0, 2), ponds=(0, 1),
        density={TREE: 10.0, BUSH: 13.0, ROCK: 8.0, WRECK: 0.2},
        on_route=((BUSH, ROCK, TREE), 2, 4),
    ),
    Family.FOREST: Recipe(
        relief=(4.4, 6.2), tilt=2.0, longest=28.0, shortest=5.0, roughness=0.05,
        way=(Surface.TRAIL,), way_width=1.8, way_by_route=0.8,
        buildings=((COTTAGE,), 0, 1), fences=(0, 0), ponds=(1, 2),
        density={TREE: 55.0, BUSH: 28.0, ROCK: 8.0},
        on_route=((TREE, BUSH, ROCK), 2, 4),
    ),
}  # fmt: skip


def generate(
    family: Family | str,
    seed: int,
    *,
    size_m: float = 48.0,
    resolution: float = 0.25,
    goal_distance: float = 12.0,
    observers: int = 1,
) -> Scenario:
    """A scenario of the family; the same arguments give the same document.

    size_m : side of the square map; resolution : metres between samples
    goal_distance : straight line from start to goal; a way with `PASSAGE` metres of room joins them
    Raises ScenarioError where the distance does not fit the map or an argument is out of range.
    """
    family = _checked(family, seed, size_m, resolution, goal_distance, observers)
    for attempt in range(MAX_ATTEMPTS):
        rng = np.random.default_rng([seed, list(Family).index(family), attempt])
        land = _Land(rng, RECIPES[family], size_m, resolution, goal_distance)
        if not land.ends_are_gentle() or not reachable(
            land.ground, land.plot.cover, *land.route, clearance=0.5 * PASSAGE
        ):
            continue
        return land.scenario(family, seed, observers)
    raise ScenarioError(
        f"seed {seed} of {family.value} gives no reachable goal {goal_distance:g} m away on a map of"
        f" {size_m:g} m in {MAX_ATTEMPTS} attempts; take a larger map or another seed"
    )


def _checked(family, seed, size_m, resolution, goal_distance, observers) -> Family:
    try:
        family = Family(family)
    except ValueError:
        raise ScenarioError(f"terrain {family!r} is none of {', '.join(Family)}") from None
    longest = size_m - 2.0 * ENDS_FROM_EDGE
    problems = [
        (not 0 <= seed < 2**63, f"seed is {seed}; it must be a whole number from 0 to 2^63 - 1"),
        (not 0.05 <= resolution <= 1.0, f"resolution is {resolution:g} m; it must be 0.05 to 1 m"),
        (
            not MIN_SIZE <= size_m <= (MAX_CELLS - 1) * resolution,
            f"size is {size_m:g} m; at {resolution:g} m a cell it must be {MIN_SIZE:g} to"
            f" {(MAX_CELLS - 1) * resolution:g} m",
        ),
        (
            not MIN_GOAL_DISTANCE <= goal_distance <= longest,
            f"goal distance is {goal_distance:g} m; on a map of {size_m:g} m it must be"
            f" {MIN_GOAL_DISTANCE:g} to {longest:g} m",
        ),
        (not 0 <= observers <= 20, f"observers is {observers}; it must be 0 to 20"),
    ]
    for wrong, message in problems:
        if wrong:
            raise ScenarioError(message)
    return family


class _Land:
    """One attempt at a scenario: ground first, then what stands on it."""

    def __init__(
        self, rng: np.random.Generator, recipe: Recipe, size_m: float, resolution: float, goal_distance: float
    ) -> None:
        self.rng, self.recipe = rng, recipe
        cells = round(size_m / resolution) + 1
        self.ground = _hills(rng, recipe, cells, resolution)
        self.half = self.ground.bounds[1]
        self.area = size_m * size_m / 1000.0
        self.route = self._ends(goal_distance)
        self.plot = Plot(self.half, *self.route)
        self.trail = Trail.through(self.ground, self._waypoints())
        self.way = recipe.way[rng.integers(len(recipe.way))]
        self._number = 0
        self._build()
        self.ground = self.trail.graded(self.ground, 0.5 * recipe.way_width + 0.2, 2.5)
        self.ponds = self._dig_ponds()
        self._finish_ground()
        self._furnish()

    # -- ground -----------------------------------------------------------------------------------

    def _ends(self, distance: float) -> Segment:
        """Start and goal on the gentlest of some random pairs of places."""
        reach = self.half - ENDS_FROM_EDGE
        slope = ndimage.maximum_filter(self.ground.slope, round(1.5 / self.ground.resolution))
        best, gentlest = None, math.inf
        for _ in range(40):
            bearing = self.rng.uniform(0.0, 2.0 * math.pi)
            along = 0.5 * distance * np.array([math.cos(bearing), math.sin(bearing)])
            room = reach - np.abs(along)
            middle = self.rng.uniform(-0.7, 0.7, 2) * room
            ends = np.round([middle - along, middle + along], 2)
            steepest = float(slope[self.ground.cells(*ends.T)].max())
            if steepest < gentlest:
                best, gentlest = ends, steepest
            if gentlest < 0.6 * GENTLE:
                break
        assert best is not None
        return tuple(best[0].tolist()), tuple(best[1].tolist())

    def _waypoints(self) -> np.ndarray:
        """A winding way across the map, by start and goal or past them."""
        start, goal = np.array(self.route)
        ahead = (goal - start) / np.linalg.norm(goal - start)
        aside = np.array([-ahead[1], ahead[0]])
        span = float(np.linalg.norm(goal - start))
        sway = float(np.clip(0.28 * span, 1.0, 4.0)) * self.rng.choice((-1.0, 1.0)) * self.rng.uniform(0.6, 1.2)
        shift = 0.0
        if self.rng.random() >= self.recipe.way_by_route:
            shift = self.rng.choice((-1.0, 1.0)) * self.rng.uniform(4.0, 0.5 * self.half)
        middle = 0.5 * (start + goal)
        inner = [start - 0.4 * ahead, middle + sway * aside, goal + 0.4 * ahead]
        outer = 2.9 * self.half
        tail = start - ahead * outer * 0.5 - sway * self.rng.uniform(0.5, 2.0) * aside
        head = goal + ahead * outer * 0.5 - sway * self.rng.uniform(0.5, 2.0) * aside
        return np.array([tail, *inner, head]) + shift * aside

    def _build(self) -> None:
        """Houses beside the way, each on a levelled pad."""
        kinds, fewest, most = self.recipe.buildings
        middle = 0.5 * np.sum(self.route, axis=0)
        for _ in range(self.rng.integers(fewest, most + 1)):
            for _ in range(30):
                x, y = middle + self.rng.normal(0.0, 0.4 * self.half, 2)
                house = self._draw(kinds, x, y)
                outline = house.footprint
                if max(abs(x), abs(y)) + outline.radius > self.half - 1.5:
                    continue
                on_way = self.trail.distance[self.ground.cell(x, y)] < outline.radius + 0.7 * self.recipe.way_width
                ends = outline.distance(np.array(self.route))
                line = np.linspace(*np.array(self.route), 40)
                blocks = outline.distance(line).min() < 0.8 and self.rng.random() > 0.15
                if not on_way and ends.min() > 2.5 and not blocks and self.plot.put(house, gap=2.6):
                    self.ground = level_pad(self.ground, outline, apron=0.8, ramp=3.0)
                    break

    def _dig_ponds(self) -> list[Pond]:
        """Water in the lowest hollows that are off the way, the route and the buildings."""
        ponds: list[Pond] = []
        fewest, most = self.recipe.ponds
        for _ in range(self.rng.integers(fewest, most + 1)):
            radius = self.rng.uniform(0.04, 0.085) * self.half * 2.0
            radius = float(np.clip(radius, 1.2, 4.5))
            places = self.rng.uniform(-self.half + radius, self.half - radius, (80, 2))
            clear = self.trail.distance[self.ground.cells(*places.T)] > 1.35 * radius + 2.0
            clear &= distance_to_segment(places, self.route) > 1.35 * radius + 2.0
            for outline in [thing.footprint for thing in self.plot.cover]:
                clear &= outline.distance(places) > 1.35 * radius + 1.5
            for pond in ponds:
                clear &= pond.distance[self.ground.cells(*places.T)] > 1.35 * radius + 3.0
            places = places[clear]
            if len(places) == 0:
                continue
            heights = ndimage.uniform_filter(self.ground.heights, round(radius / self.ground.resolution))
            x, y = places[np.argmin(heights[self.ground.cells(*places.T)])]
            pond = Pond.at(self.rng, self.ground, x, y, radius)
            self.ground = pond.filled(self.ground, bank=3.0)
            ponds.append(pond)
        return ponds

    def _finish_ground(self) -> None:
        """Fine bumps, the family's relief, and what the ground is made of."""
        ground, recipe = self.ground, self.recipe
        bumps = fractal(self.rng, ground.shape[0], ground.resolution, longest=2.0, shortest=0.8)
        calm = np.where(self.trail.distance < 0.5 * recipe.way_width, 0.4, 1.0)
        for house in self.plot.cover:
            calm = np.where(distance_to(ground, house.footprint) < 0.8, 0.2, calm)
        water = np.zeros(ground.shape, bool)
        shore = np.full(ground.shape, np.inf)
        for pond in self.ponds:
            water |= pond.water
            shore = np.minimum(shore, pond.distance)
        heights = ground.heights + np.where(water, 0.0, recipe.roughness * calm * (bumps - 0.5))
        heights = heights - heights.min()
        relief = float(heights.max())
        heights = heights * (np.clip(relief, *recipe.relief) / relief)
        self.ground = replace(ground, heights=np.round(heights, 3))
        self.ground = replace(self.ground, surface=self._surface(water, shore))
        wet = shore < 0.6
        self.plot.keep_clear(self.ground, wet | (self.trail.distance < 0.5 * recipe.way_width))

    def _surface(self, water: np.ndarray, shore: np.ndarray) -> np.ndarray:
        ground, recipe = self.ground, self.recipe
        patches = fractal(self.rng, ground.shape[0], ground.resolution, longest=9.0, shortest=2.0)
        ragged = 0.5 * (patches - 0.5)
        surface = np.full(ground.shape, SURFACES.index(Surface.GRASS), np.uint8)
        surface[patches > 0.86] = SURFACES.index(Surface.SAND if self.way is Surface.GRAVEL else Surface.TRAIL)
        surface[patches < 0.1] = SURFACES.index(Surface.MUD)
        smooth = ndimage.gaussian_filter(ground.slope, 0.4 / ground.resolution)
        surface[smooth + 0.25 * ragged > math.radians(18.0)] = SURFACES.index(Surface.ROCK)
        for house in self.plot.cover:
            yard = Surface.ASPHALT if house.kind is BUILDING else Surface.GRAVEL
            surface[distance_to(ground, house.footprint) + ragged < 1.0] = SURFACES.index(yard)
        edge = 0.0 if self.way is Surface.ASPHALT else 1.0
        surface[self.trail.distance + edge * ragged < 0.5 * recipe.way_width] = SURFACES.index(self.way)
        surface[shore + ragged < 0.9] = SURFACES.index(Surface.MUD)
        surface[water] = SURFACES.index(Surface.WATER)
        return surface

    # -- what stands on it --------------------------------------------------------------------------

    def _furnish(self) -> None:
        self._put_on_route()
        fewest, most = self.recipe.fences
        for _ in range(round(self.rng.integers(fewest, most + 1) * max(0.5, self.area / 2.3))):
            self._put_fence()
        for kind, density in self.recipe.density.items():
            for _ in range(self.rng.poisson(density * self.area)):
                for _ in range(6):
                    x, y = self.rng.uniform(-self.half, self.half, 2)
                    if self.plot.put(self._draw((kind,), x, y)):
                        break

    def _put_on_route(self) -> None:
        """Things between start and goal, on the straight line or just beside it."""
        start, goal = np.array(self.route)
        span = float(np.linalg.norm(goal - start))
        kinds, fewest, most = self.recipe.on_route
        bearing = math.degrees(math.atan2(*(goal - start)[::-1]))
        for _ in range(round(self.rng.integers(fewest, most + 1) * max(span, 6.0) / 12.0)):
            for _ in range(12):
                share = self.rng.uniform(0.15, 0.85)
                x, y = start + share * (goal - start) + self.rng.normal(0.0, 1.3, 2)
                across = bearing + 90.0 + self.rng.uniform(-35.0, 35.0)
                if self.plot.put(self._draw(kinds, x, y, (across + 180.0) % 360.0 - 180.0)):
                    break

    def _put_fence(self) -> None:
        """A row of fence panels that follows the ground."""
        for _ in range(20):
            x, y = self.rng.uniform(-self.half, self.half, 2)
            first = self._draw((FENCE,), x, y)
            yaw = math.radians(first.yaw)
            step = ((first.length or 0.0) + 0.04) * np.array([math.cos(yaw), math.sin(yaw)])
            if self.plot.put(first):
                for place in range(1, int(self.rng.integers(2, 5))):
                    self._number += 1
                    x, y = np.round((first.x, first.y) + place * step, 3)
                    panel = first.model_copy(update={"id": self._number, "x": float(x), "y": float(y)})
                    if not self.plot.put(panel, gap=0.01):
                        break
                return

    def _draw(self, kinds: tuple[CoverKind, ...], x: float, y: float, yaw: float | None = None) -> CoverObject:
        self._number += 1
        kind = kinds[self.rng.integers(len(kinds))]
        return draw(self.rng, kind, self._number, float(x), float(y), yaw)

    # -- result -----------------------------------------------------------------------------------

    def ends_are_gentle(self) -> bool:
        """Whether start and goal lie on ground that a robot stands on with ease."""
        slope = ndimage.maximum_filter(
            ndimage.gaussian_filter(self.ground.slope, 0.3 / self.ground.resolution),
            max(1, round(1.0 / self.ground.resolution)),
        )
        return bool(slope[self.ground.cells(*np.array(self.route).T)].max() < GENTLE)

    def scenario(self, family: Family, seed: int, observers: int) -> Scenario:
        (x, y), goal = self.route
        spread = 45.0 if self.rng.random() < 0.85 else 120.0
        yaw = math.degrees(math.atan2(goal[1] - y, goal[0] - x)) + self.rng.uniform(-spread, spread)
        cover = tuple(
            thing.model_copy(update={"id": number}) for number, thing in enumerate(self.plot.cover, 1)
        )
        return Scenario(
            name=f"{family.value} {seed}",
            description=f"Generated {family.value.replace('_', '-')} terrain, seed {seed}.",
            terrain=Terrain(
                resolution=self.ground.resolution,
                heights=self.ground.heights,
                surface=self.ground.surface_symbols(),
                source=GeneratedSource(family=family, seed=seed),
            ),
            start=Start(x=x, y=y, yaw=round((yaw + 180.0) % 360.0 - 180.0, 1)),
            goal=Point(x=goal[0], y=goal[1]),
            cover=cover,
            observers=place_observers(self.rng, self.ground, cover, self.route, observers),
        )


def _hills(rng: np.random.Generator, recipe: Recipe, cells: int, resolution: float) -> Heightmap:
    """Fractal hills on a tilted plane."""
    zeros = np.zeros((cells, cells), np.uint8)
    size = (cells - 1) * resolution
    longest = min(recipe.longest, size)
    low, high = recipe.relief
    height = rng.uniform(low, min(high, 3.0 * low)) if high < 4.0 or low > 1.0 else rng.uniform(low, 0.6)
    heights = height * fractal(rng, cells, resolution, longest, recipe.shortest)
    ground = Heightmap(heights, resolution, zeros, zeros)
    x, y = ground.xy()
    bearing = rng.uniform(0.0, 2.0 * math.pi)
    slope = math.tan(math.radians(rng.uniform(0.0, recipe.tilt)))
    tilted = heights + slope * (math.cos(bearing) * x + math.sin(bearing) * y)
    return replace(ground, heights=tilted)
