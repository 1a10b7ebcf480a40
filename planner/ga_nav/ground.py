"""Groups on the ground: what images say, projected to the robot's map and gathered as it drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.frames import CameraView, GridMap, Segmentation
from planner.ga_nav.groups import GROUP_CODE, GROUPS, surface_groups
from scenes.catalogue import CATALOGUE, TraversabilityGroup
from scenes.robot import HUSKY
from scenes.scenario import Scenario
from scenes.terrain import Heightmap
from scenes.traversability import mark_footprint

MAPPED_DEPTH = 10.0
"""Metres: what is farther is too coarse to be laid on the ground."""

BELOW, ABOVE = 0.4, HUSKY.height + 0.2
"""Metres under and over the ground, between which a thing counts for the cell that it stands in: a crown that
the robot passes under does not."""

TRUSTED_DEPTH = 5.0  # metres, at which an image's word counts half
KEPT = 0.6  # of what was known of a cell, whenever an image shows it again
_BACKGROUND = GROUP_CODE[TraversabilityGroup.BACKGROUND]


@dataclass(frozen=True)
class GroupCosts:
    """Points of 0..100 that a cell of each group costs besides its elevation.

    Ground not yet seen costs what rough ground does. No group forbids a cell by itself, for images err: the
    map does, where something stands.
    """

    smooth: float = 0.0
    rough: float = 8.0
    bumpy: float = 25.0
    forbidden: float = 100.0
    obstacle: float = 60.0

    @property
    def table(self) -> np.ndarray:
        """(6,) in the order of `planner.ga_nav.groups.GROUPS`."""
        return np.array([self.rough, self.smooth, self.rough, self.bumpy, self.forbidden, self.obstacle])


class GroundGroups:
    """A rolling layer over the robot's map: for each cell how much speaks for each group.

    Each image adds, for the cells that it shows, the share of a cell's pixels that each group has, weighted
    by how sure the network was and how near the cell is; what was known of them before fades.
    """

    def __init__(self) -> None:
        self._place: tuple[float, float, float] | None = None
        self._evidence = np.zeros((len(GROUPS), 0, 0), np.float32)

    def move_to(self, grid: GridMap) -> None:
        """Lie under the map's cells from now on; what falls off its edge is forgotten."""
        place = grid.x_min, grid.y_min, grid.resolution
        if place == self._place and self._evidence.shape[1:] == grid.shape:
            return
        moved = np.zeros((len(GROUPS), *grid.shape), np.float32)
        if self._place is not None and self._place[2] == grid.resolution:
            x_min, y_min, step = self._place
            rows, cols = round((grid.y_min - y_min) / step), round((grid.x_min - x_min) / step)
            old = _overlap(rows, self._evidence.shape[1], grid.shape[0])
            new = _overlap(cols, self._evidence.shape[2], grid.shape[1])
            moved[:, old[1], new[1]] = self._evidence[:, old[0], new[0]]
        self._place, self._evidence = place, moved

    def add(self, view: CameraView, groups: np.ndarray, sure: np.ndarray, grid: GridMap) -> None:
        """What an image shows; labels (h, w) and their probabilities (h, w), of an image as large as the
        camera's or a whole part of it."""
        self.move_to(grid)
        cell, label, weight = project(view, groups, sure, grid)
        if not len(cell):
            return
        count = grid.shape[0] * grid.shape[1]
        bins = label.astype(np.int64) * count + cell
        votes = np.bincount(bins, weight, len(GROUPS) * count).reshape(len(GROUPS), *grid.shape)
        pixels = np.bincount(cell, minlength=count).reshape(grid.shape)
        seen = pixels > 0
        self._evidence[:, seen] *= KEPT
        self._evidence[:, seen] += votes[:, seen] / pixels[seen]

    @property
    def labels(self) -> np.ndarray:
        """(rows, cols) uint8: the group that most speaks for, `Segmentation.UNKNOWN` where nothing does."""
        best = np.argmax(self._evidence, axis=0).astype(np.uint8)
        best[self._evidence.max(axis=0, initial=0.0) <= 0.0] = Segmentation.UNKNOWN
        return best

    def cost(self, costs: GroupCosts) -> np.ndarray:
        """(rows, cols) points: the groups' costs, each by how much speaks for it."""
        total = self._evidence.sum(axis=0)
        mean = np.tensordot(costs.table, self._evidence, 1) / np.maximum(total, 1e-9)
        return np.where(total > 0.0, mean, costs.rough)


def project(
    view: CameraView, groups: np.ndarray, sure: np.ndarray, grid: GridMap
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where an image's labels lie on the map: for n pixels the cell, as an index into the flattened grid, the
    label and its weight. Sky, what is too far, hangs, or is off the map or on unknown ground is left out."""
    stride = view.image.depth.shape[0] // groups.shape[0]
    depth = view.image.depth[::stride, ::stride]
    row, col = np.nonzero((depth <= MAPPED_DEPTH) & (groups != _BACKGROUND))
    points = view.pose.to_world(view.image.points_body(stride * row, stride * col))
    r = np.rint((points[:, 1] - grid.y_min) / grid.resolution).astype(int)
    c = np.rint((points[:, 0] - grid.x_min) / grid.resolution).astype(int)
    inside = (r >= 0) & (r < grid.shape[0]) & (c >= 0) & (c < grid.shape[1])
    cell = np.where(inside, r * grid.shape[1] + c, 0)
    over = points[:, 2] - grid.elevation.ravel()[cell]  # NaN over unknown ground, which compares as false
    kept = inside & (over > -BELOW) & (over < ABOVE)
    row, col = row[kept], col[kept]
    weight = sure[row, col] / (1.0 + (depth[row, col] / TRUSTED_DEPTH) ** 2)
    return cell[kept], groups[row, col], weight


def true_groups(scenario: Scenario, heightmap: Heightmap) -> np.ndarray:
    """(rows, cols) uint8 over the heightmap: the true group of the ground, and of what stands there."""
    groups = surface_groups(heightmap.surface)
    for thing in scenario.cover:
        under = np.zeros(heightmap.shape, bool)
        mark_footprint(under, heightmap, thing.footprint, 0.5 * heightmap.resolution)
        groups[under] = GROUP_CODE[CATALOGUE[thing.kind].group]
    return groups


def cut_out(groups: np.ndarray, heightmap: Heightmap, grid: GridMap) -> np.ndarray:
    """(rows, cols) uint8: the heightmap's groups at the map's cells, `Segmentation.UNKNOWN` beyond it."""
    x = grid.x_min + grid.resolution * np.arange(grid.shape[1])
    y = grid.y_min + grid.resolution * np.arange(grid.shape[0])
    west, east, south, north = heightmap.bounds
    on_map = ((y >= south) & (y <= north))[:, None] & ((x >= west) & (x <= east))[None]
    return np.where(on_map, groups[heightmap.cells(*np.meshgrid(x, y))], Segmentation.UNKNOWN).astype(
        np.uint8
    )


def _overlap(shift: int, old: int, new: int) -> tuple[slice, slice]:
    """The part of `old` cells that lies under `new` ones which begin `shift` cells on, counted in each."""
    first, last = max(shift, 0), min(shift + new, old)
    last = max(last, first)
    return slice(first, last), slice(first - shift, last - shift)
