"""Lines of sight over the robot's own map.

The map's ground and what stands or hangs over it (`GridMap.span`) take the place of the true scene. What the
map does not know hides nothing, but for what a class of cover object tells that the camera has found: how
much light a thing lets through, and that it has a back where the map has its face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from planner.elevation_map import without_gaps
from planner.frames import CoverEstimate, GridMap, Percept
from planner.sensed_exposure_kernel import free_above, identify, light_from
from scenes.catalogue import CATALOGUE, CoverKind
from scenes.robot import HUSKY

BESIDE = 0.3  # metres outside a cover object's outline where returns are still its own

DEPTH = 0.6
"""Shares of a class's usual width that an object reaches from its middle, where its own width does not say
less: only its face shows, and a front alone would cast the shadow of a screen."""

HOLLOW = frozenset({CoverKind.TREE, CoverKind.FENCE})
"""Kinds that do not fill their outline from the ground up."""


@dataclass(frozen=True, eq=False)
class MapSight:
    """Lines of sight over the robot's own map.

    ground : (rows, cols) heights of `grid` without gaps; stops : those below which nothing is seen
    low, high, opacity : as `occluders` returns them; free : heights above which nothing stops light
    """

    grid: GridMap
    ground: np.ndarray
    stops: np.ndarray
    low: np.ndarray
    high: np.ndarray
    free: np.ndarray
    opacity: np.ndarray

    @classmethod
    def of(cls, percept: Percept) -> MapSight:
        grid = percept.grid
        ground = without_gaps(grid.elevation.astype(float))
        stops = np.where(np.isnan(grid.elevation), -np.inf, ground)
        low, high, opacity = occluders(percept)
        return cls(grid, ground, stops, low, high, free_above(stops, low, high), opacity)

    def light(self, eye: np.ndarray, row: np.ndarray, col: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """(k, h) float32 share of light that reaches an eye (3,) in the world, on the map or off it, from
        `heights` (h,), ascending, over the ground of cells (k,)."""
        grid = self.grid
        on_map = np.array([eye[0] - grid.x_min, eye[1] - grid.y_min, eye[2]])
        on_map[:2] /= grid.resolution
        return light_from(
            self.ground, self.stops, self.low, self.high, self.free, self.opacity, heights, row, col, on_map,
            grid.resolution, HUSKY.inscribed_radius,
        )  # fmt: skip


def occluders(percept: Percept) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, cols) each: heights between which something hides, and the share of light that it stops."""
    grid = percept.grid
    low, high = grid.span.astype(float)
    there = high > low
    low[there & grid.obstacle] = -np.inf
    blobs = np.zeros(grid.shape, np.int32)
    count: int = label(there, structure=np.ones((3, 3)), output=blobs)  # type: ignore[assignment]
    things = np.array([_outline(thing, grid) for thing in percept.cover]).reshape(-1, 6)
    return low, high, identify(low, high, blobs, count, things, grid.resolution)


def _outline(thing: CoverEstimate, grid: GridMap) -> tuple[float, float, float, float, float, float]:
    """What `identify` wants to know of a cover object."""
    entry = CATALOGUE[thing.kind]
    own = 0.5 * thing.width + BESIDE
    solid = -1.0 if thing.kind in HOLLOW else min(DEPTH * entry.width.usual, 0.5 * thing.width) ** 2
    return thing.x - grid.x_min, thing.y - grid.y_min, own, solid, thing.z + thing.height, entry.opacity
