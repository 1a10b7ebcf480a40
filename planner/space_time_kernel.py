"""The search through space and time, compiled: where to be when, waiting included."""

from __future__ import annotations

import numpy as np
from numba import njit

STRAIGHT, DIAGONAL = 5, 7
"""Ticks that a move to a neighbour takes; 7 / 5 is the diagonal's length to one per cent."""

WAIT, UNREACHED = 8, 255

STEPS = np.array([(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)])
"""(8, 2) rows and columns of the moves, by heading 0, 45, ... 315 degrees."""


@njit(cache=True)
def plan(base, seen, sample_of, toll, passable, begin, end, ticks):
    """The least-cost plan from a cell at tick 0 to another at any tick up to `ticks`.

    base : (cells,) cost of a tick spent in a cell; seen : (samples, cells) what is added at the time of each
    sample; sample_of : (ticks + 1,) the sample that holds at a tick
    toll : (4, cells) cost of moving into or out of a cell by heading, half of it charged at either end
    passable : (8, rows, cols) bool, whether the move out of a cell is free
    A move of n ticks costs n times the mean of a tick at both its ends, each at its own time, and the toll; a
    tick of waiting the mean of the cell's at both its times.

    Returns the cost to be at the goal, the tick at which it is reached (-1: never), and the last move into
    each cell at each tick (ticks + 1, cells) uint8.
    """
    count, cols = base.shape[0], passable.shape[2]
    best = np.full((DIAGONAL + 1, count), np.inf)
    moves = np.full((ticks + 1, count), UNREACHED, np.uint8)
    best[0, begin] = 0.0
    least, reached = np.inf, -1
    for tick in range(ticks + 1):
        now = best[tick % (DIAGONAL + 1)]
        if now[end] < least:
            least, reached = now[end], tick
        here_seen = seen[sample_of[tick]]
        for cell in range(count):
            so_far = now[cell]
            if not so_far < least:
                continue
            here = base[cell] + here_seen[cell]
            row, col = cell // cols, cell % cols
            for move in range(WAIT + 1):
                there, duration, paid = cell, 1, 0.0
                if move < WAIT:
                    if not passable[move, row, col]:
                        continue
                    there = cell + STEPS[move, 0] * cols + STEPS[move, 1]
                    duration = STRAIGHT if move % 2 == 0 else DIAGONAL
                    paid = 0.5 * (toll[move % 4, cell] + toll[move % 4, there])
                arrival = tick + duration
                if arrival > ticks:
                    continue
                after = base[there] + seen[sample_of[arrival], there]
                cost = so_far + 0.5 * duration * (here + after) + (paid if move % 2 == 0 else 1.4 * paid)
                if cost < best[arrival % (DIAGONAL + 1), there]:
                    best[arrival % (DIAGONAL + 1), there] = cost
                    moves[arrival, there] = move
        now[:] = np.inf
    return least, reached, moves


@njit(cache=True)
def cost_of(base, seen, sample_of, toll, cells, cols):
    """Cost of going along neighbouring cells (k,) from tick 0 without waiting, as `plan` has it; inf where
    that takes longer than there are ticks."""
    total, tick = 0.0, 0
    for index in range(len(cells) - 1):
        here, there = cells[index], cells[index + 1]
        dr, dc = there // cols - here // cols, there % cols - here % cols
        axis = 2 if dc == 0 else (0 if dr == 0 else (1 if dr == dc else 3))
        duration = DIAGONAL if dr != 0 and dc != 0 else STRAIGHT
        paid = 0.5 * (toll[axis, here] + toll[axis, there]) * (1.4 if duration == DIAGONAL else 1.0)
        before = base[here] + seen[sample_of[tick], here]
        tick += duration
        if tick >= len(sample_of):
            return np.inf
        total += 0.5 * duration * (before + base[there] + seen[sample_of[tick], there]) + paid
    return total
