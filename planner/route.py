"""Least-cost routes over a grid: exact, eight-connected, with the diagonals' true length."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from planner.heap import pop, push

DIAGONAL = math.sqrt(2.0)


@dataclass(frozen=True)
class Route:
    """cells : (k, 2) int rows and columns from start to end; cost : integral of the cost over the way, with
    the cost-to-go from its last cell; reason : why there is none, empty where there is one."""

    cells: np.ndarray
    cost: float
    reason: str = ""

    @property
    def found(self) -> bool:
        return len(self.cells) > 0


def least_cost_route(
    cost: np.ndarray, resolution: float, start: tuple[int, int], goal: tuple[float, float]
) -> Route:
    """The cheapest way from a cell to a goal, which may lie outside the grid.

    cost : (rows, cols) per metre, positive; inf where forbidden
    start : (row, col); goal : (row, col), not necessarily whole, outside the grid where the goal is: then the
        way ends at the border cell from which way and straight line together are the cheapest, the straight
        line at the cheapest cost of the grid

    A* with a consistent lower bound; of equally cheap cells the first in row order goes first: the same grid
    gives the same route.
    """
    rows, cols = cost.shape
    if not (0 <= start[0] < rows and 0 <= start[1] < cols):
        return _none("the robot is outside its own map")
    if not math.isfinite(cost[start]):
        return _none("the robot stands on forbidden ground")
    inside = 0 <= round(goal[0]) < rows and 0 <= round(goal[1]) < cols
    if inside and not math.isfinite(cost[round(goal[0]), round(goal[1])]):
        return _none("the goal is on forbidden ground")
    target = (float(round(goal[0])), float(round(goal[1]))) if inside else goal
    cheapest = float(np.min(cost))
    if not cheapest > 0.0:
        raise ValueError(f"costs must be positive, the least is {cheapest}")
    cost = np.ascontiguousarray(cost, dtype=float)
    parent, end, total = _search(cost, resolution, *start, *target, inside, cheapest)
    if end < 0:
        return _none("every way to the goal is blocked" if inside else "every way out of the map is blocked")
    cells = [end]
    while cells[-1] != start[0] * cols + start[1]:
        cells.append(int(parent[cells[-1]]))
    return Route(np.stack(np.divmod(np.array(cells[::-1]), cols), axis=1), float(total))


def _none(reason: str) -> Route:
    return Route(np.zeros((0, 2), int), math.inf, reason)


def route_cost(cost: np.ndarray, resolution: float, cells: np.ndarray) -> float:
    """Integral of the cost along neighbouring cells (k, 2): metres times the mean of both ends."""
    along = cost[cells[:, 0], cells[:, 1]]
    length = resolution * np.hypot(*np.diff(cells, axis=0).T)
    return float(np.sum(0.5 * (along[1:] + along[:-1]) * length))


def line_cost(cost: np.ndarray, resolution: float, start: np.ndarray, end: np.ndarray) -> float:
    """Integral of the cost along a straight line between grid points (row, col), sampled each half cell;
    inf where it crosses forbidden cells or leaves the grid."""
    length = float(np.hypot(*(np.asarray(end) - start)))
    count = max(2, math.ceil(2.0 * length) + 1)
    points = np.rint(start + np.linspace(0.0, 1.0, count)[:, None] * (np.asarray(end) - start)).astype(int)
    if (points < 0).any() or (points >= cost.shape).any():
        return math.inf
    along = cost[points[:, 0], points[:, 1]]
    return float(np.mean(0.5 * (along[1:] + along[:-1])) * length * resolution)


@njit(cache=True)
def _bound(row, col, goal_row, goal_col, octile):
    """Least length in cells from here to the goal."""
    dr, dc = abs(row - goal_row), abs(col - goal_col)
    if octile:
        return max(dr, dc) + (DIAGONAL - 1.0) * min(dr, dc)
    return math.sqrt(dr * dr + dc * dc)


@njit(cache=True)
def _search(cost, resolution, start_row, start_col, goal_row, goal_col, inside, cheapest):
    """A* from the start: (parent cell of each cell, last cell of the way or -1, its cost)."""
    rows, cols = cost.shape
    scale = cheapest * resolution
    best = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, -1, np.int64)
    closed = np.zeros(rows * cols, np.bool_)
    keys, items, size = np.empty(1024), np.empty(1024, np.int64), 0
    first = start_row * cols + start_col
    best[first] = 0.0
    keys, items, size = push(
        keys, items, size, scale * _bound(start_row, start_col, goal_row, goal_col, inside), first
    )
    while size > 0:
        cell, size = pop(keys, items, size)
        if cell < 0:
            # The way beyond the border, kept as the negative of the cell it leaves from.
            exit_cell = -cell - 1
            row, col = exit_cell // cols, exit_cell % cols
            return parent, exit_cell, best[exit_cell] + scale * _bound(row, col, goal_row, goal_col, False)
        if closed[cell]:
            continue
        closed[cell] = True
        row, col = cell // cols, cell % cols
        if inside and row == goal_row and col == goal_col:
            return parent, cell, best[cell]
        if not inside and (row == 0 or col == 0 or row == rows - 1 or col == cols - 1):
            beyond = best[cell] + scale * _bound(row, col, goal_row, goal_col, False)
            keys, items, size = push(keys, items, size, beyond, -cell - 1)
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r, c = row + dr, col + dc
                if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= rows or c >= cols:
                    continue
                there = r * cols + c
                if closed[there] or not np.isfinite(cost[r, c]):
                    continue
                length = resolution * (DIAGONAL if dr != 0 and dc != 0 else 1.0)
                reached = best[cell] + 0.5 * (cost[row, col] + cost[r, c]) * length
                if reached < best[there]:
                    best[there] = reached
                    parent[there] = cell
                    key = reached + scale * _bound(r, c, goal_row, goal_col, inside)
                    keys, items, size = push(keys, items, size, key, there)
    return parent, -1, np.inf
