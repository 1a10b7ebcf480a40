"""Why there is no way, and where it is blocked."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.cost_map import CostMap
from planner.covert_kernel import search
from planner.frames import GridMap
from scenes.catalogue import CATALOGUE
from scenes.robot import HUSKY
from scenes.scenario import CoverObject
from scenes.terrain import Heightmap, Surface

BREAKING_THROUGH = 1e4  # cost of a metre where nobody can drive, beside 1 where one can


class NoRoute(ValueError):
    """There is no way; the message says why, `where` is the world point that it is about."""

    def __init__(self, reason: str, where: tuple[float, float]):
        super().__init__(reason)
        self.reason, self.where = reason, where


def no_route(
    costs: CostMap,
    grid: GridMap,
    heightmap: Heightmap,
    cover: Sequence[CoverObject],
    open_cells: np.ndarray,
    begin: int,
    end: int,
) -> NoRoute:
    """What is wrong with the goal's own cell, or else what first stands in the way that breaks through least.

    open_cells : (rows, cols) bool, where the robot may drive; begin, end : flat indices of the ends' cells
    """
    cost = np.where(open_cells, 1.0, BREAKING_THROUGH)
    parent, _ = search(np.repeat(cost[None], 4, axis=0), costs.resolution, begin, end)
    blocked, at = end, end
    while at != begin:
        at = int(parent[at])
        if open_cells.flat[end] and not open_cells.flat[at] and at != begin:
            blocked = at
    row, col = (int(index) for index in np.unravel_index(blocked, open_cells.shape))
    x, y = (float(value) for value in costs.centre(row, col))
    what = _what(costs, grid, heightmap, cover, row, col)
    if blocked == end:
        return NoRoute(f"the goal cannot be driven to: {what} at ({x:.1f}, {y:.1f})", (x, y))
    return NoRoute(f"every way to the goal is blocked: {what} at ({x:.1f}, {y:.1f})", (x, y))


def _what(
    costs: CostMap, grid: GridMap, heightmap: Heightmap, cover: Sequence[CoverObject], row: int, col: int
) -> str:
    """What keeps the robot off a cell, in words."""
    x, y = (float(value) for value in costs.centre(row, col))
    gaps = [float(thing.footprint.distance(np.array([[x, y]]))[0]) for thing in cover]
    room = HUSKY.inscribed_radius + 2.0 * costs.resolution
    if gaps and min(gaps) < room:
        thing = cover[int(np.argmin(gaps))]
        return f"{CATALOGUE[thing.kind].class_name} {thing.id}"
    if costs.unknown[row, col]:
        return "the survey has no data"
    reach = math.ceil(room / costs.resolution)
    rows = slice(max(row - reach, 0), row + reach + 1)
    cols = slice(max(col - reach, 0), col + reach + 1)
    near = [costs.centre(r + rows.start, c + cols.start) for r, c in np.argwhere(grid.obstacle[rows, cols])]
    if any(heightmap.surface_at(*point) is Surface.WATER for point in near):
        return "water"
    if near:
        return "a step higher than the Husky climbs"
    if min(row, col, grid.shape[0] - 1 - row, grid.shape[1] - 1 - col) < reach:
        return "the map ends"
    return "ground steeper than the Husky climbs"
