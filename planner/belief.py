"""Where an observer that has not been seen yet may stand: places to watch from that nobody has looked at.

A Monte-Carlo belief: places drawn over the map, weighted by how much they would see of the ground between
the robot and its goal, for a watcher chooses where to stand. Places that the robot's sensors have looked at
without finding anybody drop out. What such an observer would see on the mean is a layer over the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.exposure import exposure_field
from planner.line_of_sight import View
from planner.posting import points_about
from planner.spotting import SPOTTING_RANGE, in_sight
from scenes.placement import room_to_watch
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import CoverObject
from scenes.terrain import QUALITIES, Heightmap, Quality


@dataclass(frozen=True)
class BeliefConfig:
    """What is taken for granted of an observer not yet seen; metres.

    places : how many there are; drawn : how many of them, by their weights, make the layer
    eye_height, range : of its eye
    attention : chance that it looks the robot's way
    spacing, width : of the points between robot and goal that make a vantage good, and how far aside they lie
    choice : power of the share seen that a place's weight grows with; 0 is anywhere alike
    """

    places: int = 400
    drawn: int = 40
    eye_height: float = 1.7
    range: float = 40.0
    attention: float = 0.4
    spacing: float = 1.0
    width: float = 5.0
    choice: float = 2.0


class Belief:
    """Places (n, 2) with weights (n,) that add up to 1, or to 0 once every place has been looked at.

    route : where the robot comes from and goes to; rng : for the places, so that the same one gives the same
    """

    def __init__(
        self,
        rays: RayScene,
        heightmap: Heightmap,
        cover: Sequence[CoverObject],
        route: tuple[tuple[float, float], tuple[float, float]],
        rng: np.random.Generator,
        config: BeliefConfig | None = None,
    ):
        self.config = config or BeliefConfig()
        self._rays, self._heightmap = rays, heightmap
        west, east, south, north = heightmap.bounds
        drawn = rng.uniform((west, south), (east, north), (3 * self.config.places, 2))
        known = heightmap.quality[heightmap.cells(*drawn.T)] != QUALITIES.index(Quality.MISSING)
        able = known & room_to_watch(heightmap, cover, route, drawn)
        self.places = drawn[able][: self.config.places]
        self.weights = self._vantage(route)

    def look(self, pose: Pose, reach: float = SPOTTING_RANGE) -> None:
        """Rule out the places that the robot sees from `pose`, where nobody stands or somebody it knows."""
        open_ = np.flatnonzero(self.weights)
        if not len(open_):
            return
        heights = np.full(len(open_), self.config.eye_height)
        seen = in_sight(self._rays, self._heightmap, pose, self.places[open_], heights, reach)
        self.weights[open_[seen]] = 0.0
        total = self.weights.sum()
        if total > 0.0:
            self.weights = self.weights / total

    def exposure(self, *, stride: int = 1, height: float = HUSKY.height) -> np.ndarray:
        """(rows, cols) float32 chance from 0 to 1 that an observer not yet seen sees a robot in each cell.

        Over every `stride`-th cell, as `planner.exposure.exposure_field` takes them; NaN without data.
        """
        drawn = self._views(evenly_drawn(self.weights, self.config.drawn))
        field = exposure_field(self._rays, self._heightmap, drawn, stride=stride, height=height)
        if not len(field.seen):
            return field.united
        return (self.config.attention * field.seen.mean(axis=0)).astype(np.float32)

    def _views(self, indices: np.ndarray) -> list[View]:
        """All-round views from some of the places."""
        x, y = self.places[indices].T
        z = self._heightmap.height_at(x, y) + self.config.eye_height
        return [
            View(number, east, north, up, 0.0, 2.0 * np.pi, np.pi, self.config.range)
            for number, east, north, up in zip(*(part.tolist() for part in (indices, x, y, z)), strict=True)
        ]

    def _vantage(self, route: tuple[tuple[float, float], tuple[float, float]]) -> np.ndarray:
        """(n,) weights by the share that each place sees of the ground about the way."""
        points = points_about(route, self.config.spacing, self.config.width)
        inside = np.array([self._heightmap.contains(x, y) for x, y in points.tolist()])
        x, y = points[inside].T
        ground = np.column_stack([x, y, self._heightmap.height_at(x, y) + HUSKY.height])
        share = np.zeros(len(self.places))
        for index, view in enumerate(self._views(np.arange(len(self.places)))):
            held = ground[view.holds(ground)]
            light = self._rays.visible(np.broadcast_to(view.eye, held.shape), held)
            share[index] = light.sum() / max(len(ground), 1)
        weights = share**self.config.choice
        total = weights.sum()
        return weights / total if total > 0.0 else weights


def evenly_drawn(weights: np.ndarray, count: int) -> np.ndarray:
    """(count,) indices, ascending, each as often as its weight says; none where all weights are 0."""
    upto = np.cumsum(weights)
    if not len(upto) or upto[-1] <= 0.0:
        return np.zeros(0, np.int64)
    steps = (np.arange(count) + 0.5) / count
    return np.searchsorted(upto, steps * upto[-1])
