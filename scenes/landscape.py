"""A landscape after a recipe: the ground first, then what stands on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from scenes.catalogue import CoverKind
from scenes.placement import Plot, Segment, distance_to_segment, draw
from scenes.relief import Pond, Trail, distance_to, fractal, level_pad
from scenes.scenario import MAX_COVER, CoverObject, CoverSpec
from scenes.terrain import SURFACE_CODE, Heightmap, Surface

ENDS_FROM_EDGE = 2.5
GENTLE = math.radians(9.0)
ROCKY = math.radians(20.0)


@dataclass(frozen=True)
class Recipe:
    """What a family of terrain is made of; metres and degrees.

    hills : lowest and highest of them; longest, shortest : their wavelengths
    tilt : steepest inclination of the map as a whole
    relief : bounds of highest minus lowest ground once all is shaped
    roughness : height of the finest bumps
    way, way_width : surfaces of the path through the map to draw from
    way_by_route : how often the path passes start and goal
    buildings, fences, ponds : fewest and most; building_kinds to draw from
    density : objects a 1000 m²
    on_route : fewest and most things between start and goal for every 12 m; route_kinds to draw from
    """

    hills: tuple[float, float]
    longest: float
    shortest: float
    tilt: float
    relief: tuple[float, float]
    roughness: float
    way: tuple[Surface, ...]
    way_width: float
    way_by_route: float
    building_kinds: tuple[CoverKind, ...]
    buildings: tuple[int, int]
    fences: tuple[int, int]
    ponds: tuple[int, int]
    density: Mapping[CoverKind, float]
    route_kinds: tuple[CoverKind, ...]
    on_route: tuple[int, int]


class Landscape:
    """One draw from a recipe.

    ground : the finished Heightmap; route : start and goal; cover : what stands on the ground
    """

    def __init__(
        self, rng: np.random.Generator, recipe: Recipe, size_m: float, resolution: float, goal_distance: float
    ) -> None:
        self.rng = rng
        self.recipe = recipe
        self.ground = _hills(rng, recipe, round(size_m / resolution) + 1, resolution)
        self.half = self.ground.bounds[1]
        self.area = size_m * size_m / 1000.0
        self.route = self._ends(goal_distance)
        self.plot = Plot(self.half, self.route)
        self.trail = Trail.through(self.ground, self._waypoints())
        self.way = recipe.way[rng.integers(len(recipe.way))]
        self._build()
        self.ground = self.trail.graded(self.ground, 0.5 * recipe.way_width + 0.2, 2.5)
        self.pond = self._dig_ponds()
        self._finish_ground()
        self._furnish()

    @property
    def cover(self) -> list[CoverObject]:
        return self.plot.cover

    def ends_are_gentle(self) -> bool:
        """Whether start and goal lie on ground that a robot stands on with ease."""
        smooth = ndimage.gaussian_filter(self.ground.slope, 0.3 / self.ground.resolution)
        around = ndimage.maximum_filter(smooth, max(1, round(1.0 / self.ground.resolution)))
        return bool(around[self.ground.cells(*np.transpose(self.route))].max() < GENTLE)

    def _ends(self, distance: float) -> Segment:
        """Start and goal at the gentlest of some random pairs of places."""
        slope = ndimage.maximum_filter(self.ground.slope, max(1, round(1.5 / self.ground.resolution)))
        best, gentlest = np.zeros((2, 2)), math.inf
        for _ in range(40):
            bearing = self.rng.uniform(0.0, 2.0 * math.pi)
            along = 0.5 * distance * np.array([math.cos(bearing), math.sin(bearing)])
            middle = self.rng.uniform(-0.7, 0.7, 2) * (self.half - ENDS_FROM_EDGE - np.abs(along))
            ends = np.round([middle - along, middle + along], 2)
            steepest = float(slope[self.ground.cells(*ends.T)].max())
            if steepest < gentlest:
                best, gentlest = ends, steepest
            if gentlest < 0.6 * GENTLE:
                break
        (x, y), (goal_x, goal_y) = best.tolist()
        return (x, y), (goal_x, goal_y)

    def _waypoints(self) -> np.ndarray:
        """A winding way across the map, by start and goal or past them."""
        start, goal = np.array(self.route)
        span = float(np.hypot(*(goal - start)))
        ahead = (goal - start) / span
        aside = np.array([-ahead[1], ahead[0]]) * self.rng.choice((-1.0, 1.0))
        sway = float(np.clip(0.28 * span, 1.0, 4.0)) * self.rng.uniform(0.6, 1.2)
        beyond = 1.45 * self.half * ahead
        course = np.array(
            [
                start - beyond - sway * self.rng.uniform(0.5, 2.0) * aside,
                start - 0.4 * ahead,
                0.5 * (start + goal) + sway * aside,
                goal + 0.4 * ahead,
                goal + beyond - sway * self.rng.uniform(0.5, 2.0) * aside,
            ]
        )
        shift = self.rng.choice((-1.0, 1.0)) * self.rng.uniform(4.0, 0.5 * self.half)
        return course if self.rng.random() < self.recipe.way_by_route else course + shift * aside

    def _build(self) -> None:
        """Houses off the way, each on a levelled pad; few of them bar the straight line to the goal."""
        middle = 0.5 * np.sum(self.route, axis=0)
        line = np.linspace(self.route[0], self.route[1], 40)
        for _ in range(self.rng.integers(*self.recipe.buildings, endpoint=True)):
            for _ in range(30):
                x, y = middle + self.rng.normal(0.0, 0.4 * self.half, 2)
                house = self._draw(self.recipe.building_kinds, x, y)
                outline = house.footprint
                bars = outline.distance(line).min() < 0.8 and self.rng.random() > 0.15
                at_end = outline.distance(np.array(self.route)).min() < 2.5
                on_way = self.trail.distance[self.ground.cell(x, y)] < outline.radius + self.recipe.way_width
                drop = float(np.ptp(self.ground.height_at(*outline.lattice(1.0).T)))
                if not (bars or at_end or on_way or drop > 0.9) and self.plot.put(house, gap=2.6):
                    self.ground = level_pad(self.ground, outline, apron=0.8, ramp=2.0 + 3.0 * drop)
                    break

    def _dig_ponds(self) -> Pond:
        """Water in low, level hollows off the way, the route and the buildings."""
        ground, pond = self.ground, Pond.none(self.ground)
        for _ in range(self.rng.integers(*self.recipe.ponds, endpoint=True)):
            radius = float(np.clip(self.rng.uniform(0.08, 0.17) * self.half, 1.2, 4.5))
            reach = 1.35 * radius
            places = self.rng.uniform(-self.half + radius, self.half - radius, (80, 2))
            cells = self.ground.cells(*places.T)
            room = np.minimum(self.trail.distance[cells], distance_to_segment(places, self.route)) - 2.0
            room = np.minimum(room, pond.distance[cells] - 3.0)
            for house in self.cover:
                room = np.minimum(room, house.footprint.distance(places) - 1.5)
            places = places[room > reach]
            if len(places) == 0:
                continue
            window = round(2.0 * (radius + 1.5) / ground.resolution)
            drop = ndimage.maximum_filter(ground.heights, window) - ndimage.minimum_filter(
                ground.heights, window
            )
            height = ndimage.uniform_filter(ground.heights, window)
            awkward = (2.0 * drop + height)[ground.cells(*places.T)]
            x, y = places[np.argmin(awkward)]
            hollow = Pond.at(self.rng, ground, x, y, radius)
            self.ground = ground = hollow.filled(ground, bank=2.0 + 1.5 * drop[ground.cell(x, y)])
            pond = pond.joined(hollow)
        return pond

    def _finish_ground(self) -> None:
        """Fine bumps, the family's relief, and what the ground is made of."""
        ground, recipe = self.ground, self.recipe
        bumps = fractal(self.rng, ground.shape[0], ground.resolution, longest=2.0, shortest=0.8) - 0.5
        on_way = self.trail.distance < 0.5 * recipe.way_width
        bumps[on_way] *= 0.4
        for house in self.cover:
            bumps[distance_to(ground, house.footprint) < 0.8] *= 0.2
        bumps[self.pond.water] = 0.0
        heights = ground.heights + recipe.roughness * bumps
        heights = heights - heights.min()
        relief = float(heights.max())
        heights = np.round(heights * (np.clip(relief, *recipe.relief) / relief), 3)
        self.ground = ground = replace(ground, heights=heights)
        self.ground = replace(ground, surface=self._surface(ground))
        self.plot.keep_clear(self.ground, on_way | (self.pond.distance < 0.6))

    def _surface(self, ground: Heightmap) -> np.ndarray:
        """(rows, cols) codes: patches on grass, rock where it is steep, yards, the way, mud by the water."""
        patches = fractal(self.rng, ground.shape[0], ground.resolution, longest=9.0, shortest=2.0)
        ragged = 0.5 * (patches - 0.5)
        surface = np.full(ground.shape, SURFACE_CODE[Surface.GRASS], np.uint8)
        surface[patches > 0.86] = SURFACE_CODE[Surface.SAND]
        surface[patches < 0.1] = SURFACE_CODE[Surface.MUD]
        slope = ndimage.gaussian_filter(ground.slope, 0.4 / ground.resolution)
        surface[slope + 0.25 * ragged > ROCKY] = SURFACE_CODE[Surface.ROCK]
        for house in self.cover:
            yard = Surface.ASPHALT if house.kind is CoverKind.BUILDING else Surface.GRAVEL
            surface[distance_to(ground, house.footprint) + ragged < 1.0] = SURFACE_CODE[yard]
        frayed = self.trail.distance + (0.0 if self.way is Surface.ASPHALT else ragged)
        surface[frayed < 0.5 * self.recipe.way_width] = SURFACE_CODE[self.way]
        surface[self.pond.distance + ragged < 0.9] = SURFACE_CODE[Surface.MUD]
        surface[self.pond.water] = SURFACE_CODE[Surface.WATER]
        return surface

    def _furnish(self) -> None:
        self._put_on_route()
        for _ in range(
            round(self.rng.integers(*self.recipe.fences, endpoint=True) * max(0.5, self.area / 2.3))
        ):
            self._put_fence()
        share = self._share_that_fits(self.area * sum(self.recipe.density.values()))
        for kind, density in self.recipe.density.items():
            for _ in range(self.rng.poisson(share * density * self.area)):
                for _ in range(6):
                    if self.plot.put(self._draw((kind,), *self._anywhere())):
                        break

    def _share_that_fits(self, wanted: float) -> float:
        """How much of so many things, drawn with Poisson's spread, a scenario has room for: on large maps
        they stand thinner."""
        room = MAX_COVER - len(self.cover)
        return min(1.0, max(0.0, room - 5.0 * math.sqrt(room)) / wanted)

    def _put_on_route(self) -> None:
        """Things on the straight line from start to goal or just beside it, fences and wrecks across it."""
        start, goal = np.array(self.route)
        along = goal - start
        span, bearing = math.hypot(*along), math.degrees(math.atan2(along[1], along[0]))
        count = self.rng.integers(*self.recipe.on_route, endpoint=True)
        for _ in range(round(count * max(span, 6.0) / 12.0)):
            for _ in range(12):
                x, y = start + self.rng.uniform(0.15, 0.85) * along + self.rng.normal(0.0, 1.3, 2)
                across = bearing + 90.0 + self.rng.uniform(-35.0, 35.0)
                if self.plot.put(self._draw(self.recipe.route_kinds, x, y, across)):
                    break

    def _put_fence(self) -> None:
        """A row of fence panels that follows the ground."""
        for _ in range(20):
            first = self._draw((CoverKind.FENCE,), *self._anywhere())
            if not self.plot.put(first):
                continue
            yaw, pitch = math.radians(first.yaw), first.length + 0.04
            for place in range(1, int(self.rng.integers(2, 5))):
                x, y = first.x + place * pitch * math.cos(yaw), first.y + place * pitch * math.sin(yaw)
                panel = first.model_copy(update={"x": round(x, 3), "y": round(y, 3)})
                if not self.plot.put(panel, gap=0.01):
                    break
            return

    def _anywhere(self) -> tuple[float, float]:
        x, y = self.rng.uniform(-self.half, self.half, 2)
        return float(x), float(y)

    def _draw(self, kinds: tuple[CoverKind, ...], x: float, y: float, yaw: float | None = None) -> CoverSpec:
        return draw(self.rng, kinds[self.rng.integers(len(kinds))], x, y, yaw)


def _hills(rng: np.random.Generator, recipe: Recipe, cells: int, resolution: float) -> Heightmap:
    """Fractal hills on a tilted plane, all grass."""
    longest = min(recipe.longest, (cells - 1) * resolution)
    heights = rng.uniform(*recipe.hills) * fractal(rng, cells, resolution, longest, recipe.shortest)
    blank = np.zeros((cells, cells), np.uint8)
    ground = Heightmap(heights, resolution, blank, blank)
    x, y = ground.xy()
    bearing, slope = rng.uniform(0.0, 2.0 * math.pi), math.tan(math.radians(rng.uniform(0.0, recipe.tilt)))
    return replace(ground, heights=heights + slope * (math.cos(bearing) * x + math.sin(bearing) * y))
