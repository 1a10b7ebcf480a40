"""Covert routes against the clock: where to be when, with patrols on their beats, waiting in cover allowed.

The map is thinned to cells of half a metre and time to ticks, of which a straight move takes five and a
diagonal one seven; over that graph the plan is exact. Every way without waiting is one of its plans, so the
best of them cannot cost more than the best static route on the same cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from planner.covert_kernel import search
from planner.covert_route import CovertPlanner, CovertRoute
from planner.exposure import beat_period, common_cycle
from planner.hull_exposure import HEADINGS
from planner.line_of_sight import views_at
from planner.no_route import NoRoute
from planner.pace import SAMPLE_SPACING, Course
from planner.route_exposure import course_exposure
from planner.space_time_kernel import STEPS, STRAIGHT, UNREACHED, WAIT, cost_of, plan
from scenes.robot import HUSKY
from scenes.scenario import Observer

BODY = np.ones((3, 3), bool)
"""Cells about its middle that the robot's body reaches into."""


@dataclass(frozen=True)
class SpaceTimeConfig:
    """cell : metres, about; sample : seconds between looks at what the patrols see
    unhurried : share of the robot's cruising speed that the plan counts on, for who is early can wait
    slack, longest_wait : the plan may take `slack` times the quickest way's time and so many seconds more
    """

    cell: float = 0.5
    sample: float = 1.0
    unhurried: float = 0.8
    slack: float = 1.8
    longest_wait: float = 20.0


@dataclass(frozen=True, eq=False)
class _Graph:
    """Costs of one start, goal and weight, see `space_time_kernel.plan`.

    useful : (samples, cells) bool, where the robot can be at the time and still arrive
    """

    base: np.ndarray
    seen: np.ndarray
    useful: np.ndarray
    sample_of: np.ndarray
    toll: np.ndarray
    begin: int
    end: int


class SpaceTimePlanner:
    """Plans over a `CovertPlanner`'s map; the drive begins at `time_s` of the patrols' clock."""

    def __init__(self, covert: CovertPlanner, time_s: float = 0.0, config: SpaceTimeConfig | None = None):
        self.covert, self.time_s, self.config = covert, time_s, config or SpaceTimeConfig()
        self._step = max(1, round(self.config.cell / covert.costs.resolution))
        self._pick = (slice(None, None, self._step),) * 2
        self.resolution = self._step * covert.costs.resolution
        speed = self.config.unhurried * covert.config.pace.cruise
        self.tick_s = self.resolution / (STRAIGHT * speed)

    @cached_property
    def open(self) -> np.ndarray:
        """(rows, cols) bool: cells where the robot may be."""
        return ~self.covert.costs.forbidden[self._pick]

    @cached_property
    def passable(self) -> np.ndarray:
        """(8, rows, cols) bool by heading 0, 45, ... degrees: whether the move out of a cell is free on the
        fine cells between, too."""
        fine = ~self.covert.costs.forbidden
        rows, cols = fine.shape
        row, col = np.indices(fine.shape)[:, :: self._step, :: self._step]
        free = np.ones((len(STEPS), *self.open.shape), bool)
        for move, (dr, dc) in zip(free, STEPS.tolist(), strict=True):
            for part in range(self._step + 1):
                r, c = row + part * dr, col + part * dc
                inside = (r >= 0) & (r < rows) & (c >= 0) & (c < cols)
                move &= inside & fine[np.clip(r, 0, rows - 1), np.clip(c, 0, cols - 1)]
        return free

    def route(
        self, start: tuple[float, float], goal: tuple[float, float], weight: float = 0.9
    ) -> CovertRoute:
        """The least-cost plan from start (world x, y) at `time_s` to goal; `weight` as in `CovertPlanner`.

        `times` of the route are seconds from the start at which each of its points is reached; a point where
        the robot waits is there twice, and in `waits`.
        Raises NoRoute where there is none, ValueError for a weight outside 0..1.
        """
        graph = self._graph(start, goal, weight)
        ticks = len(graph.sample_of) - 1
        cost, reached, moves = plan(
            graph.base, graph.seen, graph.sample_of, graph.toll, self.passable, graph.begin, graph.end, ticks
        )
        if reached < 0:
            raise NoRoute("no plan reaches the goal in time", goal)
        cells, at_tick = self._trace(moves, graph, reached)
        points = self._centres(cells)
        points[0], points[-1] = start, goal
        return self._timed(points, self.tick_s * at_tick, weight, float(cost))

    def best_static(
        self, start: tuple[float, float], goal: tuple[float, float], weight: float = 0.9
    ) -> tuple[float, np.ndarray]:
        """Cost of the best way for the patrols' mean exposure when it is driven against the clock without
        waiting, and its cells (k,): what a plan in space and time is to undercut."""
        graph = self._graph(start, goal, weight)
        ever = np.maximum(graph.useful.sum(axis=0), 1)
        mean = graph.base + np.where(graph.useful, graph.seen, 0.0).sum(axis=0) / ever
        metres = mean * STRAIGHT / self.resolution + graph.toll / self.resolution
        cost = np.where(graph.useful.any(axis=0), metres, np.inf).reshape(4, *self.open.shape)
        parent, best = search(cost, self.resolution, graph.begin, graph.end)
        if not math.isfinite(best[graph.end]):
            raise NoRoute("no way leads to the goal", goal)
        cells = [graph.end]
        while cells[-1] != graph.begin:
            cells.append(int(parent[cells[-1]]))
        way = np.array(cells[::-1])
        return self.cost_along(graph, way), way

    def cost_along(self, graph: _Graph, cells: np.ndarray) -> float:
        """Cost of a way along neighbouring cells (k,), driven from the start without waiting."""
        return float(cost_of(graph.base, graph.seen, graph.sample_of, graph.toll, cells, self.open.shape[1]))

    # --- costs -----------------------------------------------------------------------------------

    def _graph(self, start: tuple[float, float], goal: tuple[float, float], weight: float) -> _Graph:
        covert = self.covert
        quickest, _ = covert.way(start, goal, 0.0)  # says clearly why there is none
        if not 0.0 <= weight <= 1.0:
            raise ValueError(f"the exposure weight must be 0 to 1, got {weight:g}")
        horizon = self.config.slack * covert.duration(quickest) + self.config.longest_wait
        ticks = math.ceil(horizon / self.tick_s)
        begin, end = self._nearest_open(start), self._nearest_open(goal)
        per_sample = max(1, round(self.config.sample / self.tick_s))
        cycle = common_cycle(covert.observers)
        samples = math.ceil((min(cycle, horizon) if cycle else 0.0) / (per_sample * self.tick_s)) + 1
        period = max(1, round(cycle / (per_sample * self.tick_s))) if cycle else 1
        sample_of = np.arange(ticks + 1) // per_sample % min(samples, period)
        useful = self._useful(begin, end, sample_of)
        times = self.time_s + per_sample * self.tick_s * (np.arange(int(sample_of.max()) + 1) + 0.5)
        points = np.minimum(np.sum(list(covert.costs.layers.values()), axis=0), 100.0)[self._pick].ravel()
        time = max(1.0 - weight, covert.config.time_share) * (1.0 + points / covert.config.points_per_second)
        seen = self._seen(useful, times) if weight > 0.0 else np.zeros(useful.shape, np.float32)
        toll = covert.treacherous[:, *self._pick].reshape(len(HEADINGS), -1)
        return _Graph(
            self.tick_s * time,
            self.tick_s * weight * covert.config.exposed_second * seen,
            useful,
            sample_of,
            covert.config.treacherous * self.resolution * toll,
            begin,
            end,
        )

    def _seen(self, useful: np.ndarray, times: np.ndarray) -> np.ndarray:
        """(times, cells) share of the robot that is seen in the cells that are of use, about: the mean over
        its height and the cells about, for its body reaches into them."""
        ground = self.covert.grid.elevation[self._pick].ravel()
        heights = np.unique(HUSKY.hull_points()[:, 2])[[0, -1]]
        places = np.column_stack([self._centres(np.arange(ground.size)), ground])
        points = np.stack([places + np.array([0.0, 0.0, height]) for height in heights])
        size = (len(times), *self.open.shape)
        body = np.asarray(ndimage.binary_dilation(useful.reshape(size), BODY[None])).reshape(useful.shape)
        light = np.zeros((len(times), len(heights), ground.size), np.float32)
        for observer in self.covert.observers:
            for time_s, rows in _moments(observer, times):
                use = body[rows].any(axis=0)
                seen = self._light(observer, points[:, use], time_s)
                for row in rows:
                    light[row][:, use] = np.maximum(light[row][:, use], seen)
        share = light.mean(axis=1).reshape(size)
        return np.asarray(ndimage.uniform_filter(share, axes=(1, 2), size=len(BODY), mode="nearest")).reshape(
            useful.shape
        )

    def _light(self, observer: Observer, points: np.ndarray, time_s: float) -> np.ndarray:
        """(heights, n) share of light from points (heights, n, 3) to an observer."""
        flat = points.reshape(-1, 3)
        light = np.zeros(len(flat), np.float32)
        view = views_at([observer], self.covert.heightmap, time_s)[0]
        held = view.holds(flat)
        if held.any():
            light[held] = self.covert.rays.visible(view.eye, flat[held])
        return light.reshape(points.shape[:2])

    def _useful(self, begin: int, end: int, sample_of: np.ndarray) -> np.ndarray:
        """(samples, cells) bool: where the robot can be at some tick of a sample and still arrive."""
        cost = np.repeat(np.where(self.open, 1.0, np.inf)[None], 4, axis=0)
        # By the true diagonal, which is a little longer than its ticks.
        gone, left = (0.98 * search(cost, float(STRAIGHT), cell, -1)[1] for cell in (begin, end))
        useful = np.zeros((int(sample_of.max()) + 1, len(gone)), bool)
        last = len(sample_of) - 1
        firsts = np.flatnonzero(np.diff(sample_of, prepend=-1))
        for first, until in zip(firsts, [*firsts[1:], last + 1], strict=True):
            useful[sample_of[first]] |= (gone <= until) & (left <= last - first)
        return useful

    def _nearest_open(self, point: tuple[float, float]) -> int:
        """Flat index of the open cell nearest to a point."""
        cells = np.flatnonzero(self.open)
        offset = self._centres(cells) - point
        return int(cells[int(np.argmin(np.hypot(offset[:, 0], offset[:, 1])))])

    def _centres(self, cells: np.ndarray) -> np.ndarray:
        """(n, 2) world points of flat indices."""
        row, col = np.divmod(cells, self.open.shape[1])
        return self.covert.costs.centre(row * self._step, col * self._step)

    # --- plans -----------------------------------------------------------------------------------

    def _trace(self, moves: np.ndarray, graph: _Graph, reached: int) -> tuple[np.ndarray, np.ndarray]:
        """Cells (k,) of the plan with the ticks (k,) at which they are reached, waits as repeated cells."""
        cols = self.open.shape[1]
        cells, ticks, waiting = [graph.end], [reached], False
        cell, tick = graph.end, reached
        while tick > 0:
            move = int(moves[tick, cell])
            if move == UNREACHED:
                break
            if move == WAIT:
                tick -= 1
                if waiting:
                    ticks[-1] = tick
                else:
                    cells.append(cell)
                    ticks.append(tick)
                waiting = True
                continue
            tick -= STRAIGHT if move % 2 == 0 else STRAIGHT + 2
            cell -= int(STEPS[move, 0]) * cols + int(STEPS[move, 1])
            cells.append(cell)
            ticks.append(tick)
            waiting = False
        return np.array(cells[::-1]), np.array(ticks[::-1])

    def _timed(self, points: np.ndarray, times: np.ndarray, weight: float, cost: float) -> CovertRoute:
        kept = _corners(points, times)
        points, times = points[kept], times[kept]
        course = _course(points, times)
        seen = course_exposure(
            self.covert.rays, self.covert.heightmap, self.covert.observers, course, begun_s=self.time_s
        )
        lengths = np.hypot(*np.diff(points, axis=0).T)
        waits = tuple(
            ((float(points[index, 0]), float(points[index, 1])), float(times[index]), float(times[index + 1]))
            for index in np.flatnonzero(lengths < 1e-9)
        )
        return CovertRoute(
            points,
            float(lengths.sum()),
            float(times[-1]),
            seen.exposed_s,
            seen.longest_exposure_s,
            seen.detection_probability,
            cost,
            weight,
            waits,
            times,
        )


def _moments(observer: Observer, times: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Moments at which to look at what an observer sees, each with the indices of the `times` (n,) that it
    stands for: one where nobody walks, else as many a beat as there are times in it."""
    beat = beat_period(observer)
    if not beat:
        return [(0.0, np.arange(len(times)))]
    spacing = float(times[1] - times[0]) if len(times) > 1 else beat
    count = max(1, round(beat / spacing))
    phase = np.floor(times % beat / beat * count).astype(int) % count
    return [((now + 0.5) * beat / count, np.flatnonzero(phase == now)) for now in np.unique(phase)]


def _corners(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(k,) bool: the points of a timed way at which it turns, or changes its speed."""
    velocity = np.diff(points, axis=0) / np.maximum(np.diff(times), 1e-9)[:, None]
    turns = np.hypot(*(velocity[1:] - velocity[:-1]).T) > 1e-6
    return np.concatenate([[True], turns, [True]]) if len(points) > 2 else np.ones(len(points), bool)


def _course(points: np.ndarray, times: np.ndarray) -> Course:
    """Places along a timed way about `SAMPLE_SPACING` metres, or as many seconds, apart."""
    positions, yaws, seconds, yaw = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0)], 0.0
    for begin, end, since, until in zip(points[:-1], points[1:], times[:-1], times[1:], strict=True):
        length = math.dist(begin, end)
        count = max(1, math.ceil(max(length, float(until - since)) / SAMPLE_SPACING))
        yaw = math.atan2(*(end - begin)[::-1]) if length > 0.0 else yaw
        share = (np.arange(count) + 0.5) / count
        positions.append(begin + share[:, None] * (end - begin))
        yaws.append(np.full(count, yaw))
        seconds.append(np.full(count, (until - since) / count))
    return Course(np.concatenate(positions), np.concatenate(yaws), np.concatenate(seconds))
