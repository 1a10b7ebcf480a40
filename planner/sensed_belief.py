"""Where an observer not yet seen may stand, as far as the robot's own map tells.

As `planner.belief`, which knows the whole ground, but over the map that the robot has made: what it does not
know hides nothing, and a place counts as looked at only where the map knows something beside it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from planner.belief import BeliefConfig, evenly_drawn
from planner.frames import GridMap, Percept
from planner.line_of_sight import SEEN
from planner.map_sight import MapSight
from planner.posting import points_about
from planner.sensed_exposure import spread
from planner.spotting import FIGURE_MIDDLE, SPOTTING_RANGE
from scenes.robot import HUSKY

STRIDE = 4
"""Cells of the map to a cell of the layer, each way."""

BESIDE = 1.0  # metres from a place within which the map knows something where it has been looked at


class SensedBelief:
    """Places (n, 2) about the straight way to the goal, `open` (n,) bool until they have been looked at.

    route : where the robot comes from and goes to; rng : for the places, so that the same one gives the same
    """

    def __init__(
        self,
        route: tuple[tuple[float, float], tuple[float, float]],
        rng: np.random.Generator,
        config: BeliefConfig | None = None,
    ):
        self.config = config or BeliefConfig(places=200, drawn=16)
        ends = np.array(route)
        about = 0.5 * self.config.range
        low, high = ends.min(axis=0) - about, ends.max(axis=0) + about
        self.places = rng.uniform(low, high, (self.config.places, 2))
        self.open = np.ones(len(self.places), bool)
        self._points = points_about(route, self.config.spacing, self.config.width)

    def look(self, percept: Percept, on_map: MapSight) -> None:
        """Rule out the places that the robot sees from where it is."""
        grid = percept.grid
        width = 2 * round(BESIDE / grid.resolution) + 1
        known = np.asarray(maximum_filter(~grid.unknown, size=width))
        index, row, col = _on(grid, self.places, self.open)
        told = np.flatnonzero(known[row, col])
        index, row, col = index[told], row[told], col[told]
        heights = np.array([FIGURE_MIDDLE, self.config.eye_height])
        for mount in (HUSKY.lidar_mount, HUSKY.camera_mount):
            sensor = percept.pose.compose(mount).position
            near = np.linalg.norm(self.places[index] - sensor[:2], axis=1) <= SPOTTING_RANGE
            light = on_map.light(sensor, row[near], col[near], heights)
            self.open[index[near][(light >= SEEN).any(axis=1)]] = False

    def weights(self, on_map: MapSight) -> np.ndarray:
        """(n,) by the share that each place sees of the ground about the way; 0 where nobody can stand or
        where the robot has looked."""
        grid = on_map.grid
        _, row, col = _on(grid, self._points)
        height = np.array([HUSKY.height])
        weights = np.zeros(len(self.places))
        for index in np.flatnonzero(self.open).tolist():
            if grid.contains(*self.places[index]) and grid.obstacle[grid.cell(*self.places[index])]:
                continue
            light = on_map.light(self._eye(index, on_map), row, col, height)
            weights[index] = light.sum() / max(len(row), 1)
        return weights**self.config.choice

    def exposure(self, on_map: MapSight) -> np.ndarray:
        """(rows, cols) float32 over the map: the chance from 0 to 1 that an observer not yet seen sees a
        robot in a cell."""
        grid = on_map.grid
        rows, cols = (np.arange(0, size, STRIDE) for size in grid.shape)
        row, col = (part.ravel() for part in np.meshgrid(rows, cols, indexing="ij"))
        there = np.column_stack(
            [
                grid.x_min + col * grid.resolution,
                grid.y_min + row * grid.resolution,
                on_map.ground[row, col] + HUSKY.height,
            ]
        )
        drawn = evenly_drawn(self.weights(on_map), self.config.drawn)
        chance = np.zeros(len(row), np.float32)
        for place, times in zip(*np.unique(drawn, return_counts=True), strict=True):
            eye = self._eye(int(place), on_map)
            within = np.flatnonzero(np.linalg.norm(there - eye, axis=1) <= self.config.range)
            light = on_map.light(eye, row[within], col[within], np.array([HUSKY.height]))[:, 0]
            chance[within] += self.config.attention * (times / len(drawn)) * light
        return spread(chance.reshape(len(rows), len(cols)), STRIDE, grid.shape)

    def _eye(self, index: int, on_map: MapSight) -> np.ndarray:
        x, y = self.places[index]
        rows, cols = on_map.grid.shape
        row, col = on_map.grid.cell(x, y)
        ground = on_map.ground[min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)]
        return np.array([x, y, ground + self.config.eye_height])


def _on(
    grid: GridMap, points: np.ndarray, wanted: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the points (n, 2) that lie on the map, of those that are `wanted` (n,), and their cells."""
    row, col = grid.cells(*points.T)
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    index = np.flatnonzero(inside if wanted is None else inside & wanted)
    return index, row[index], col[index]
