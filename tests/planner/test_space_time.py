"""Plans in space and time: the least of all, never dearer than a static way, waiting where that helps."""

import heapq
import math

import numpy as np
import pytest
from scenes_to_hide_in import GOAL, START, behind_a_wall, eye, flat, wall

from planner.covert_route import CovertPlanner
from planner.no_route import NoRoute
from planner.space_time import SpaceTimePlanner, _course
from planner.space_time_kernel import DIAGONAL, STEPS, STRAIGHT, WAIT, plan
from scenes.scenario import Patrol, Point

ROWS, COLS, TICKS = 4, 5, 60


def plain_plan(base, seen, sample_of, toll, passable, begin, end):
    """Dijkstra over (cell, tick), from dictionaries: the least cost to the goal at any tick."""
    best, queue = {(begin, 0): 0.0}, [(0.0, begin, 0)]
    ticks = len(sample_of) - 1
    while queue:
        so_far, cell, tick = heapq.heappop(queue)
        if so_far > best[cell, tick]:
            continue
        if cell == end:
            return so_far
        row, col = divmod(cell, COLS)
        for move in range(WAIT + 1):
            there, duration, paid = cell, 1, 0.0
            if move < WAIT:
                if not passable[move, row, col]:
                    continue
                there = cell + STEPS[move, 0] * COLS + STEPS[move, 1]
                duration = STRAIGHT if move % 2 == 0 else DIAGONAL
                paid = 0.5 * (toll[move % 4, cell] + toll[move % 4, there]) * (1.0 if move % 2 == 0 else 1.4)
            if tick + duration > ticks:
                continue
            ends = base[cell] + seen[sample_of[tick], cell] + base[there]
            ends += seen[sample_of[tick + duration], there]
            reached = so_far + 0.5 * duration * ends + paid
            if reached < best.get((there, tick + duration), math.inf):
                best[there, tick + duration] = reached
                heapq.heappush(queue, (reached, there, tick + duration))
    return math.inf


def small_graph(seed: int):
    rng = np.random.default_rng(seed)
    open_cells = rng.random((ROWS, COLS)) > 0.15
    open_cells[0, 0] = open_cells[-1, -1] = True
    passable = np.zeros((8, ROWS, COLS), bool)
    for move, (dr, dc) in enumerate(STEPS):
        for row in range(ROWS):
            for col in range(COLS):
                r, c = row + dr, col + dc
                inside = 0 <= r < ROWS and 0 <= c < COLS
                passable[move, row, col] = inside and open_cells[row, col] and open_cells[r, c]
    base = rng.uniform(0.01, 0.05, ROWS * COLS)
    seen = rng.uniform(0.0, 1.0, (6, ROWS * COLS)) * (rng.random((6, ROWS * COLS)) > 0.4)
    return base, seen, np.arange(TICKS + 1) // 10 % 6, rng.uniform(0.0, 0.3, (4, ROWS * COLS)), passable


@pytest.mark.parametrize("seed", range(25))
def test_the_plan_is_the_least_of_all(seed):
    base, seen, sample_of, toll, passable = small_graph(seed)
    cost, reached, _ = plan(base, seen, sample_of, toll, passable, 0, ROWS * COLS - 1, TICKS)
    known = plain_plan(base, seen, sample_of, toll, passable, 0, ROWS * COLS - 1)
    assert (reached < 0) == math.isinf(known)
    assert math.isinf(known) or cost == pytest.approx(known, rel=1e-12)


def patrolled(count: int = 1) -> CovertPlanner:
    """A wall with the robot's way on either side, and observers who walk round about it."""
    beats = [Patrol(waypoints=(Point(x=9.0, y=-9.0), Point(x=-9.0, y=-9.0)), speed=1.5)] * count
    observers = [
        eye(1 + index, -9.0 + 3.0 * index, 9.0, patrol=beat, fov_horizontal=120.0)
        for index, beat in enumerate(beats)
    ]
    return CovertPlanner(flat(), [wall(1, 0.0, 0.0, 9.0)], observers)


@pytest.mark.parametrize("weight", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("time_s", [0.0, 13.0])
def test_a_plan_never_costs_more_than_the_best_static_way(weight, time_s):
    planner = SpaceTimePlanner(patrolled(), time_s)
    static, way = planner.best_static(START, GOAL, weight)
    assert planner.route(START, GOAL, weight).cost <= static * (1.0 + 1e-9)
    assert len(way) > 5


def test_with_nobody_walking_it_is_a_static_way():
    planner = SpaceTimePlanner(behind_a_wall())
    static, _ = planner.best_static(START, GOAL, 0.9)
    route = planner.route(START, GOAL, 0.9)
    # The static search counts the diagonal's true length, the ticks a hundredth less.
    assert route.waits == () and static * 0.98 <= route.cost <= static * (1.0 + 1e-9)


def test_it_waits_in_cover_until_a_watcher_has_turned_his_back():
    # He walks away and back; his look sweeps the gap that the robot has to cross.
    beat = Patrol(waypoints=(Point(x=0.0, y=9.0),), speed=0.5)
    watcher = eye(1, 0.0, 2.0, yaw=90.0, fov_horizontal=90.0, patrol=beat)
    walls = [wall(1, -5.5, -3.0, 9.0), wall(2, 5.5, -3.0, 9.0)]
    covert = CovertPlanner(flat(), walls, [watcher])
    route = SpaceTimePlanner(covert, time_s=14.0).route((-6.0, -6.0), (6.0, -6.0), 0.95)
    at_once = covert.along(covert.route((-6.0, -6.0), (6.0, -6.0), 0.0).points, begun_s=14.0)
    assert route.exposed_s < 0.6 < 1.5 < at_once.exposed_s
    assert sum(until - since for _, since, until in route.waits) > 1.0


def test_times_and_waits_are_those_of_the_points():
    route = SpaceTimePlanner(patrolled(), 5.0).route(START, GOAL, 0.9)
    assert route.times is not None and route.times[0] == 0.0 and (np.diff(route.times) > 0.0).all()
    assert route.times[-1] == route.duration_s
    for (x, y), since, until in route.waits:
        index = int(np.flatnonzero(route.times == since)[0])
        assert tuple(route.points[index]) == (x, y) == tuple(route.points[index + 1])
        assert route.times[index + 1] == until
    drive = _course(route.points, route.times)
    assert drive.seconds.sum() == pytest.approx(route.duration_s)


def test_no_way_is_said_as_for_static_routes():
    covert = CovertPlanner(flat(), [wall(1, 0.0, 0.0, 24.0, yaw=90.0)], [eye()])
    with pytest.raises(NoRoute, match="building 1"):
        SpaceTimePlanner(covert).route((-6.0, 0.0), (6.0, 0.0))
