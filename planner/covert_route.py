"""Covert routes: least-cost ways over slope, obstacles and exposure, from the shortest to the most hidden.

The cost of a way is its time, dearer on rough and narrow ground, and the seconds for which the robot is
seen; one weight from 0 to 1 says how much the second counts against the first. Over all weights the engine
gives the least exposure that a way of some length can have: the bound that drives are measured against.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from planner.cost_map import CostConfig, CostMap, build, obstacle_distance, open_about
from planner.covert_kernel import search, straighten
from planner.dwa import DwaConfig
from planner.elevation_map import MapConfig
from planner.frames import GridMap
from planner.hull_exposure import HEADINGS, HullExposure, hull_exposure
from planner.no_route import NoRoute, no_route
from planner.oracle import true_grid
from planner.pace import Pace, course
from planner.route_exposure import course_exposure
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import CoverObject, Observer
from scenes.terrain import Heightmap

BALANCED = 0.5
LONGEST = 2.0
"""How many times as long as the shortest route the most hidden one may be."""


@dataclass(frozen=True)
class CovertConfig:
    """exposed_second : seconds of hidden driving that a second in full view is worth at the weight 0.5
    time_share : least share of the time's own weight, so that among equally hidden ways the quick one wins
    points_per_second : points of the cost map (0..100) that make a second count twice
    treacherous : cost of a metre on ground that the dynamic window will hardly take, whatever the weight
    lean : share of the window's tilt limits from which ground is that
    wheel_room : metres about what is too steep that are so, too
    turning_room : metres from obstacles up to which ground is ever more so, for the robot hardly turns there
    cell : least size of the grid's cells in metres; span : cells of a way that one straight line may replace
    """

    exposed_second: float = 6.0
    time_share: float = 0.03
    points_per_second: float = 30.0
    treacherous: float = 20.0
    lean: float = 0.75
    wheel_room: float = 0.45
    turning_room: float = 0.9
    cell: float = 0.2
    span: int = 60
    pace: Pace = field(default_factory=Pace)
    cost: CostConfig = field(default_factory=CostConfig)
    dwa: DwaConfig = field(default_factory=DwaConfig)


@dataclass(frozen=True, eq=False)
class CovertRoute:
    """A way from start to goal, with the figures of a drive along it at the robot's pace.

    points : (k, 2) world corners, start and goal among them
    exposed_s : united visible fraction integrated over the drive
    cost : what the search minimised, in seconds
    waits : where it stands still in cover, and from when until when: ((x, y), s, s) since the start
    times : (k,) seconds since the start at which the points are to be reached, where the time matters
    """

    points: np.ndarray
    length_m: float
    duration_s: float
    exposed_s: float
    longest_exposure_s: float
    detection_probability: float
    cost: float
    weight: float
    waits: tuple[tuple[tuple[float, float], float, float], ...] = ()
    times: np.ndarray | None = None

    @property
    def exposure_fraction(self) -> float:
        """Exposed share of the drive."""
        return self.exposed_s / self.duration_s if self.duration_s > 0.0 else 0.0


class CovertPlanner:
    """Routes over one true map, for observers whose places and beats are known.

    Patrols count with their exposure's mean over the common cycle; `planner.space_time` plans against the
    clock. `rays` must hold the same ground and cover; it is made where left out.
    """

    def __init__(
        self,
        heightmap: Heightmap,
        cover: Sequence[CoverObject],
        observers: Sequence[Observer],
        rays: RayScene | None = None,
        config: CovertConfig | None = None,
    ):
        self.heightmap, self.cover, self.observers = heightmap, tuple(cover), tuple(observers)
        self.rays = rays or RayScene(heightmap, cover)
        self.config = config or CovertConfig()
        self._stride = max(1, round(self.config.cell / heightmap.resolution))

    @cached_property
    def exposure(self) -> HullExposure:
        """What the observers see, over the cells of `grid`."""
        return hull_exposure(self.rays, self.heightmap, self.observers, stride=self._stride)

    @cached_property
    def grid(self) -> GridMap:
        """The true map in the cells that routes are made of."""
        first = min((self._stride - 1) // 2, min(self.heightmap.shape) - 1)
        rows, cols = (len(range(first, size, self._stride)) for size in self.heightmap.shape)
        resolution = self.heightmap.resolution
        return true_grid(
            self.heightmap,
            self.cover,
            self.heightmap.x_min + first * resolution,
            self.heightmap.y_min + first * resolution,
            (rows, cols),
            MapConfig(resolution=resolution * self._stride),
        )

    @cached_property
    def costs(self) -> CostMap:
        """Slope, roughness and nearness to obstacles; forbidden on unknown ground and at the border."""
        costs = build(self.grid, self.config.cost)
        forbidden = costs.forbidden | costs.unknown
        rim = math.ceil(self.config.cost.rim / costs.resolution)
        inner = np.zeros_like(forbidden)
        inner[rim : -rim or None, rim : -rim or None] = True
        return replace(costs, forbidden=forbidden | ~inner)

    @cached_property
    def clearance(self) -> np.ndarray:
        """(rows, cols) metres to the nearest obstacle."""
        return obstacle_distance(self.grid)

    @cached_property
    def treacherous(self) -> np.ndarray:
        """(4, rows, cols) from 0 to 1 by heading: drivable, but the dynamic window will hardly take it, for
        there the robot would lean far, have a wheel near what is too steep, or no room to turn."""
        dwa, resolution = self.config.dwa, self.costs.resolution
        span = 2 * max(1, round(0.5 * HUSKY.wheelbase / resolution)) - 1
        ground = self.grid.elevation.astype(float)
        ground[np.isnan(ground)] = np.nanmean(ground) if not np.isnan(ground).all() else 0.0
        north, east = np.gradient(ndimage.uniform_filter(ground, span, mode="nearest"), resolution)
        cos, sin = (part(HEADINGS)[:, None, None] for part in (np.cos, np.sin))
        along = (cos * east + sin * north) / math.tan(dwa.pitch_limit)
        across = (cos * north - sin * east) / math.tan(dwa.roll_limit)
        steep = self.costs.forbidden & (self.clearance >= self.config.cost.rim) & ~self.costs.unknown
        steep_away = np.asarray(ndimage.distance_transform_edt(~steep, sampling=resolution))
        near_steep = steep_away < self.config.wheel_room
        bad = (np.hypot(along, across) > self.config.lean) | (near_steep & steep.any())
        rim, room = self.config.cost.rim, self.config.turning_room
        return np.maximum(bad, np.clip((room - self.clearance) / (room - rim), 0.0, 1.0) ** 2)

    def shun(self, x: float, y: float, radius: float) -> None:
        """From now on lead routes past the places within `radius` of (x, y) as past treacherous ground, for a
        drive there has failed."""
        self.treacherous[:, self.costs.within(radius, (x, y))] = 1.0

    def shun_nothing(self) -> None:
        """Forget the places that were shunned."""
        self.__dict__.pop("treacherous", None)

    # --- routes ----------------------------------------------------------------------------------

    def route(
        self,
        start: tuple[float, float],
        goal: tuple[float, float],
        weight: float = BALANCED,
        yaw: float | None = None,
    ) -> CovertRoute:
        """The least-cost route from start to goal (world x, y), exact over the grid and then straightened.

        weight : 0 is the shortest way, 1 the most hidden; between them a second in full view is worth
            `exposed_second` · weight / (1 - weight) hidden ones
        yaw : of the robot at the start, where turning to the route shall count in its figures
        Raises NoRoute where there is none, ValueError for a weight outside 0..1.
        """
        points, cost = self.way(start, goal, weight)
        return self.along(points, weight=weight, cost=cost, yaw=yaw)

    def way(
        self, start: tuple[float, float], goal: tuple[float, float], weight: float
    ) -> tuple[np.ndarray, float]:
        """Corners (k, 2) and cost of `route`, without the figures of a drive. Raises as it does."""
        if not 0.0 <= weight <= 1.0:
            raise ValueError(f"the exposure weight must be 0 to 1, got {weight:g}")
        seconds, begin, end = self._seconds(start, goal)
        cost = self._cost(seconds, weight)
        parent, best = search(cost, self.costs.resolution, begin, end)
        if not math.isfinite(best[end]):
            free = np.isfinite(seconds)
            raise no_route(self.costs, self.grid, self.heightmap, self.cover, free, begin, end)
        cells = [end]
        while cells[-1] != begin:
            cells.append(int(parent[cells[-1]]))
        way = np.stack(np.divmod(np.array(cells[::-1]), cost.shape[2]), axis=1)
        kept, total = straighten(cost, self.costs.resolution, way, self.config.span)
        points = self.costs.centre(*way[kept].T)
        points[0], points[-1] = start, goal
        return points, float(total)

    def duration(self, points: np.ndarray) -> float:
        """Seconds that a drive along a way (k, 2) takes."""
        return float(course(points, self.config.pace, self._clearance_at).seconds.sum())

    def alternatives(
        self, start: tuple[float, float], goal: tuple[float, float], yaw: float | None = None
    ) -> tuple[CovertRoute, CovertRoute, CovertRoute]:
        """The shortest route, a balanced one, and the most hidden of at most twice the length."""
        return (
            self.route(start, goal, 0.0, yaw),
            self.route(start, goal, BALANCED, yaw),
            self.bound(start, goal, yaw=yaw),
        )

    def bound(
        self,
        start: tuple[float, float],
        goal: tuple[float, float],
        longest: float = LONGEST,
        yaw: float | None = None,
    ) -> CovertRoute:
        """The least exposed of the engine's routes over all weights that are no longer than `longest` times
        the shortest. Raises NoRoute."""
        shortest = self.route(start, goal, 0.0, yaw)
        best, low, high = shortest, 0.0, None
        for weight in (1.0, 0.97, 0.9, 0.75, 0.5):
            found = self.route(start, goal, weight, yaw)
            if found.length_m > longest * shortest.length_m:
                high = weight
                continue
            best, low = min(best, found, key=_exposure), max(low, weight)
        for _ in range(4 if high is not None else 0):
            weight = 0.5 * (low + float(high or 1.0))
            found = self.route(start, goal, weight, yaw)
            if found.length_m > longest * shortest.length_m:
                high = weight
            else:
                best, low = min(best, found, key=_exposure), weight
        return best

    def along(
        self,
        points: np.ndarray,
        *,
        weight: float = math.nan,
        cost: float = math.nan,
        yaw: float | None = None,
        begun_s: float = 0.0,
    ) -> CovertRoute:
        """A way given by its corners (k, 2), with the figures of a drive along it that begins at `begun_s` of
        the patrols' clock."""
        drive = course(points, self.config.pace, self._clearance_at, yaw)
        seen = course_exposure(self.rays, self.heightmap, self.observers, drive, begun_s=begun_s)
        return CovertRoute(
            points,
            float(np.hypot(*np.diff(points, axis=0).T).sum()),
            float(drive.seconds.sum()),
            seen.exposed_s,
            seen.longest_exposure_s,
            seen.detection_probability,
            cost,
            weight,
        )

    # --- costs -----------------------------------------------------------------------------------

    def _seconds(self, start: tuple[float, float], goal: tuple[float, float]) -> tuple[np.ndarray, int, int]:
        """Seconds a metre (rows, cols), inf where forbidden, and the flat indices of the ends' cells."""
        costs, pace = self.costs, self.config.pace
        for name, point in (("start", start), ("goal", goal)):
            if not self.grid.contains(*point):
                raise NoRoute(f"the {name} is off the map at ({point[0]:g}, {point[1]:g})", point)
        rows, cols = self.grid.shape
        x = costs.x_min + costs.resolution * np.arange(cols)
        y = costs.y_min + costs.resolution * np.arange(rows)
        to_goal = np.hypot(x - goal[0], y[:, None] - goal[1])
        seconds = 1.0 / np.minimum(pace.speed(self.clearance), pace.arriving(to_goal))
        seconds[costs.forbidden] = np.inf
        slow, closed = 1.0 / pace.slow, self.grid.obstacle | costs.unknown
        open_about(seconds, costs, np.array(start), HUSKY.circumscribed_radius, slow, closed)
        open_about(seconds, costs, np.array(goal), HUSKY.inscribed_radius, slow, closed)
        begin, end = (int(np.ravel_multi_index(costs.cell(*p), self.grid.shape)) for p in (start, goal))
        if not math.isfinite(seconds.flat[begin]):
            seconds.flat[begin] = slow
        return seconds, begin, end

    def _cost(self, seconds: np.ndarray, weight: float) -> np.ndarray:
        """(4, rows, cols) cost a metre by heading."""
        points = np.minimum(np.sum(list(self.costs.layers.values()), axis=0), 100.0)
        time = max(1.0 - weight, self.config.time_share) * (1.0 + points / self.config.points_per_second)
        forbidden = np.isinf(seconds)
        pace = np.where(forbidden, 0.0, seconds)
        cost = time * pace + self.config.treacherous * self.treacherous
        if weight > 0.0:
            cost += weight * self.config.exposed_second * pace * self.exposure.fraction
        cost[:, forbidden] = np.inf
        return cost

    def _clearance_at(self, positions: np.ndarray) -> np.ndarray:
        cells = np.rint((positions[:, ::-1] - (self.costs.y_min, self.costs.x_min)) / self.costs.resolution)
        row, col = np.clip(cells.astype(int), 0, np.array(self.grid.shape) - 1).T
        return self.clearance[row, col]


def _exposure(route: CovertRoute) -> tuple[float, float]:
    return route.exposed_s, route.length_m
