"""The search with costs by heading: against plain Python, and its straightening."""

import heapq
import math
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.covert_kernel import line, search, straighten

AXIS = {(0, 1): 0, (1, 1): 1, (1, 0): 2, (1, -1): 3}


def axis_of(dr: int, dc: int) -> int:
    return AXIS.get((dr, dc), AXIS.get((-dr, -dc), -1))


def plain_costs(cost, resolution, start):
    """Dijkstra's cost to every cell, from a dictionary."""
    _, rows, cols = cost.shape
    best, queue = {start: 0.0}, [(0.0, start)]
    while queue:
        so_far, (row, col) = heapq.heappop(queue)
        if so_far > best[row, col]:
            continue
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if (dr, dc) == (0, 0) or not (0 <= r < rows and 0 <= c < cols):
                    continue
                axis = axis_of(dr, dc)
                mean = 0.5 * (cost[axis, row, col] + cost[axis, r, c])
                reached = so_far + mean * resolution * math.hypot(dr, dc)
                if math.isfinite(reached) and reached < best.get((r, c), math.inf):
                    best[r, c] = reached
                    heapq.heappush(queue, (reached, (r, c)))
    return best


def field(seed: int, blocked: float = 0.2) -> np.ndarray:
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.1, 5.0, (4, 9, 11))
    cost[:, rng.random((9, 11)) < blocked] = np.inf
    cost[:, 0, 0] = cost[:, -1, -1] = 1.0
    return cost


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_the_search_settles_every_cell_at_its_least_cost(seed):
    cost = field(seed)
    _, best = search(cost, 0.5, 0, -1)
    plain = plain_costs(cost, 0.5, (0, 0))
    for row in range(9):
        for col in range(11):
            found, known = best[row * 11 + col], plain.get((row, col), math.inf)
            assert found == known or math.isclose(found, known, rel_tol=1e-12)


def simple_ways(open_cells, start, goal):
    """Every way without a repeated cell, depth first."""
    ways, rows, cols = [], *open_cells.shape

    def extend(way):
        row, col = way[-1]
        if (row, col) == goal:
            ways.append(list(way))
            return
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                r, c = row + dr, col + dc
                if 0 <= r < rows and 0 <= c < cols and open_cells[r, c] and (r, c) not in way:
                    extend([*way, (r, c)])

    extend([start])
    return ways


def way_cost(cost, way) -> float:
    total = 0.0
    for (row, col), (r, c) in pairwise(way):
        axis = axis_of(r - row, c - col)
        total += 0.5 * (cost[axis, row, col] + cost[axis, r, c]) * math.hypot(r - row, c - col)
    return total


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_route_is_the_cheapest_of_all_that_there_are(seed):
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.0, 3.0, (4, 3, 4)) + 0.01
    cost[:, rng.random((3, 4)) < 0.15] = np.inf
    cost[:, 0, 0] = cost[:, 2, 3] = 0.5
    ways = simple_ways(np.isfinite(cost[0]), (0, 0), (2, 3))
    _, best = search(cost, 1.0, 0, 11)
    least = min((way_cost(cost, way) for way in ways), default=math.inf)
    assert best[11] == least or math.isclose(best[11], least, rel_tol=1e-12)


def test_between_neighbours_a_line_costs_what_the_search_charges():
    cost = field(3, blocked=0.0)
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            if (dr, dc) != (0, 0):
                edge = way_cost(cost, [(4, 5), (4 + dr, 5 + dc)])
                assert math.isclose(line(cost, 1.0, 4, 5, 4 + dr, 5 + dc), edge, rel_tol=1e-12)


def test_a_line_through_forbidden_cells_is_forbidden():
    cost = np.ones((4, 5, 9))
    cost[:, 2, 4] = np.inf
    assert math.isinf(line(cost, 1.0, 2, 0, 2, 8)) and math.isinf(line(cost, 1.0, 1, 0, 3, 8))
    assert line(cost, 0.5, 0, 0, 0, 8) == 4.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_straightening_never_makes_a_way_dearer(seed):
    cost = field(seed)
    parent, best = search(cost, 0.5, 0, 98)
    if not math.isfinite(best[98]):
        return
    cells = [98]
    while cells[-1] != 0:
        cells.append(int(parent[cells[-1]]))
    way = np.stack(np.divmod(np.array(cells[::-1]), 11), axis=1)
    kept, total = straighten(cost, 0.5, way, 60)
    assert total <= best[98] + 1e-9 and kept[0] == 0 and kept[-1] == len(way) - 1
    corners = way[kept]
    again = sum(line(cost, 0.5, *a, *b) for a, b in pairwise(corners))
    assert math.isclose(again, total, rel_tol=1e-9)


def test_an_open_field_is_crossed_straight():
    cost = np.ones((4, 12, 30))
    parent, best = search(cost, 1.0, 0, 5 * 30 + 29)
    cells = [5 * 30 + 29]
    while cells[-1] != 0:
        cells.append(int(parent[cells[-1]]))
    way = np.stack(np.divmod(np.array(cells[::-1]), 30), axis=1)
    kept, total = straighten(cost, 1.0, way, 60)
    assert len(kept) == 2 and math.isclose(total, math.hypot(5, 29)) and total < best[5 * 30 + 29]
