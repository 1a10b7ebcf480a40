"""Least-cost routes: exact, deterministic, and clear about why there is none."""

import heapq
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.route import least_cost_route, line_cost, route_cost

OPEN = np.ones((9, 12))


def plain_cost(cost, resolution, start, goal):
    """Dijkstra's cost to every cell, then to the goal: by its cell, or over the border and straight on."""
    best, queue = {start: 0.0}, [(0.0, start)]
    while queue:
        so_far, (row, col) = heapq.heappop(queue)
        if so_far > best[row, col]:
            continue
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if (dr, dc) == (0, 0) or not (0 <= r < cost.shape[0] and 0 <= c < cost.shape[1]):
                    continue
                reached = so_far + 0.5 * (cost[row, col] + cost[r, c]) * resolution * math.hypot(dr, dc)
                if math.isfinite(reached) and reached < best.get((r, c), math.inf):
                    best[r, c] = reached
                    heapq.heappush(queue, (reached, (r, c)))
    if 0 <= goal[0] < cost.shape[0] and 0 <= goal[1] < cost.shape[1]:
        return best.get(goal, math.inf)
    last_row, last_col = cost.shape[0] - 1, cost.shape[1] - 1
    return min(
        (
            reached + cost.min() * resolution * math.dist(cell, goal)
            for cell, reached in best.items()
            if cell[0] in (0, last_row) or cell[1] in (0, last_col)
        ),
        default=math.inf,
    )


def test_open_ground_is_crossed_by_the_true_octile_length():
    route = least_cost_route(OPEN, 0.5, (1, 1), (4, 10))
    assert route.cost == pytest.approx(0.5 * (6 + 3 * math.sqrt(2)))
    assert tuple(route.cells[0]) == (1, 1) and tuple(route.cells[-1]) == (4, 10)


def test_forbidden_cells_are_gone_around():
    cost = OPEN.copy()
    cost[:8, 6] = np.inf
    route = least_cost_route(cost, 1.0, (1, 1), (1, 10))
    assert np.isfinite(cost[tuple(route.cells.T)]).all()
    assert (8, 6) in set(map(tuple, route.cells))


def test_dear_ground_is_gone_around_when_that_is_cheaper():
    cost = OPEN.copy()
    cost[3:6, 4:8] = 50.0
    route = least_cost_route(cost, 1.0, (4, 0), (4, 11))
    assert cost[tuple(route.cells.T)].max() == 1.0


@pytest.mark.parametrize("goal", [(4, 30), (-20, 5), (40.5, 40.5)])
def test_a_goal_beyond_the_grid_is_left_toward_by_the_best_border_cell(goal):
    route = least_cost_route(OPEN, 1.0, (4, 5), goal)
    row, col = route.cells[-1]
    assert row in (0, 8) or col in (0, 11)
    assert route.cost == pytest.approx(plain_cost(OPEN, 1.0, (4, 5), goal))


@pytest.mark.parametrize(
    ("forbidden", "start", "goal", "reason"),
    [
        ((), (-1, 3), (4, 4), "outside its own map"),
        (np.s_[2, 2], (2, 2), (4, 4), "robot stands on forbidden"),
        (np.s_[4, 4], (2, 2), (4, 4), "goal is on forbidden"),
        (np.s_[:, 6], (2, 2), (4, 9), "every way to the goal is blocked"),
        (np.s_[3, :], (2, 2), (4, 9), "every way to the goal is blocked"),
        (
            np.s_[[1, 1, 1, 2, 2, 3, 3, 3], [1, 2, 3, 1, 3, 1, 2, 3]],
            (2, 2),
            (4, 99),
            "every way out of the map",
        ),
    ],
)
def test_without_a_route_the_reason_is_given(forbidden, start, goal, reason):
    cost = OPEN.copy()
    if forbidden != ():
        cost[forbidden] = np.inf
    route = least_cost_route(cost, 1.0, start, goal)
    assert not route.found and route.cost == math.inf
    assert reason in route.reason


def test_costs_must_be_positive():
    with pytest.raises(ValueError, match="positive"):
        least_cost_route(np.zeros((9, 9)), 1.0, (1, 1), (5, 5))


@st.composite
def mazes(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = rng.integers(2, 18, 2)
    cost = rng.choice([1.0, 1.0, 2.0, rng.uniform(1, 9)], shape)
    cost[rng.random(shape) < rng.choice([0.0, 0.3, 0.5])] = np.inf
    start = tuple(int(i) for i in rng.integers(0, shape))
    cost[start] = 1.0
    goal = tuple(int(i) for i in (rng.integers(0, shape) if rng.random() < 0.7 else rng.integers(-30, 60, 2)))
    return cost, start, goal


@settings(max_examples=200)
@given(mazes())
def test_routes_cost_what_a_plain_search_finds(case):
    cost, start, goal = case
    route = least_cost_route(cost, 0.2, start, goal)
    assert route.cost == pytest.approx(plain_cost(cost, 0.2, start, goal), abs=1e-9)
    if route.found:
        steps = np.abs(np.diff(route.cells, axis=0)).max(axis=1, initial=0)
        assert (steps == 1).all()
        assert np.isfinite(cost[tuple(route.cells.T)]).all()


@settings(max_examples=30)
@given(mazes())
def test_the_same_grid_gives_the_same_route(case):
    cost, start, goal = case
    one, two = least_cost_route(cost, 0.2, start, goal), least_cost_route(cost.copy(), 0.2, start, goal)
    np.testing.assert_array_equal(one.cells, two.cells)


def test_a_route_costs_the_mean_of_both_ends_times_the_length_of_each_step():
    cost = np.array([[1.0, 3.0], [1.0, 5.0]])
    assert route_cost(cost, 2.0, np.array([[0, 0], [0, 1], [1, 0]])) == pytest.approx(
        2.0 * 2.0 + 2.0 * 2.0 * math.sqrt(2)
    )
    assert route_cost(cost, 2.0, np.array([[1, 1]])) == 0.0


def test_a_line_costs_its_length_and_is_infinite_through_what_is_forbidden_or_off_the_grid():
    cost = 2.0 * OPEN
    cost[4, 6] = np.inf
    assert line_cost(cost, 0.5, np.array([1.0, 1.0]), np.array([1.0, 9.0])) == pytest.approx(2.0 * 8 * 0.5)
    assert line_cost(cost, 0.5, np.array([4.0, 1.0]), np.array([4.0, 9.0])) == math.inf
    assert line_cost(cost, 0.5, np.array([1.0, 1.0]), np.array([1.0, 20.0])) == math.inf
