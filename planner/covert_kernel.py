"""Least-cost ways over a grid whose cost depends on the heading, and their straightening; compiled.

Costs are per metre for headings along 0, 45, 90 and 135 degrees, or against them: (4, rows, cols), inf where
forbidden. Between those headings the cost is interpolated.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planner.heap import pop, push
from planner.route import DIAGONAL


@njit(cache=True)
def search(cost, resolution, start, goal):
    """Dijkstra over the eight neighbours from one cell, row * cols + col, to another.

    An edge costs its length times the mean of its ends' costs along its heading. Returns the parent of each
    cell (-1: none) and the cost to each cell that is settled or seen (inf: not reached); with a goal below 0
    every cell that can be reached is settled.
    """
    _, rows, cols = cost.shape
    best = np.full(rows * cols, np.inf)
    parent = np.full(rows * cols, -1, np.int64)
    closed = np.zeros(rows * cols, np.bool_)
    keys, items, size = np.empty(1024), np.empty(1024, np.int64), 0
    best[start] = 0.0
    keys, items, size = push(keys, items, size, 0.0, start)
    while size > 0:
        cell, size = pop(keys, items, size)
        if closed[cell]:
            continue
        closed[cell] = True
        if cell == goal:
            break
        row, col = cell // cols, cell % cols
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r, c = row + dr, col + dc
                if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= rows or c >= cols:
                    continue
                there = r * cols + c
                if closed[there]:
                    continue
                axis = 2 if dc == 0 else (0 if dr == 0 else (1 if dr == dc else 3))
                length = resolution * (DIAGONAL if dr != 0 and dc != 0 else 1.0)
                reached = best[cell] + 0.5 * (cost[axis, row, col] + cost[axis, r, c]) * length
                if reached < best[there]:
                    best[there] = reached
                    parent[there] = cell
                    keys, items, size = push(keys, items, size, reached, there)
    return parent, best


@njit(cache=True)
def line(cost, resolution, row, col, end_row, end_col):
    """Cost of the straight way between two cells. Where it crosses the rows or columns of samples, whichever
    it crosses more of, the cost is interpolated between the two cells beside it, and the trapezium rule taken
    over the crossings: between neighbours that is the edge's cost in `search`."""
    dr, dc = end_row - row, end_col - col
    count = max(abs(dr), abs(dc))
    if count == 0:
        return 0.0
    turn = (math.atan2(dr, dc) / (0.25 * math.pi)) % 4.0
    share = turn - math.floor(turn)
    axis = int(turn) % 4
    after = (axis + 1) % 4
    total = 0.0
    for k in range(count + 1):
        r, c = row + dr * k / count, col + dc * k / count
        low_row, low_col = math.floor(r), math.floor(c)
        beside = (r - low_row) + (c - low_col)  # one of them is whole
        here = (1.0 - share) * cost[axis, low_row, low_col] + share * cost[after, low_row, low_col]
        if beside > 0.0:
            r2, c2 = math.ceil(r), math.ceil(c)
            there = (1.0 - share) * cost[axis, r2, c2] + share * cost[after, r2, c2]
            here = (1.0 - beside) * here + beside * there
        if not np.isfinite(here):
            return np.inf
        total += here * (0.5 if k == 0 or k == count else 1.0)
    return total / count * math.sqrt(dr * dr + dc * dc) * resolution


@njit(cache=True)
def straighten(cost, resolution, cells, span):
    """The cheapest way along straight lines between cells of a way (k, 2), none longer than `span` cells of
    it: indices into `cells`, first and last among them. Never dearer than the way itself."""
    count = len(cells)
    best = np.full(count, np.inf)
    before = np.full(count, -1, np.int64)
    best[0] = 0.0
    for to in range(1, count):
        for since in range(max(0, to - span), to):
            straight = line(cost, resolution, cells[since, 0], cells[since, 1], cells[to, 0], cells[to, 1])
            if best[since] + straight < best[to] - 1e-12:
                best[to] = best[since] + straight
                before[to] = since
    kept = np.empty(count, np.int64)
    size, at = 0, count - 1
    while at >= 0:
        kept[size] = at
        size += 1
        at = before[at]
    return kept[:size][::-1].copy(), best[count - 1]
