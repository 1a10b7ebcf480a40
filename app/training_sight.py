"""What a policy sees of the ground about it, and the truth beside it, for those who watch it learn.

Patches are (40, 40), body frame as `planner.observation.observe`: axis 0 to the left, axis 1 forward.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from planner.elevation_map import PATCH_CELLS, PATCH_RESOLUTION
from planner.line_of_sight import views_at
from planner.observation import ELEVATION_LIMIT, LAYERS, patch_points
from scenes.catalogue import CATALOGUE
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Scenario
from scenes.terrain import Heightmap
from scenes.traversability import blocked_cells

FULL_COST = 100.0


class Seen(StrEnum):
    """What a patch shows: metres above the robot; visible share; presence of cover; the network's attention;
    cost from 0 to 100, inf where barred."""

    ELEVATION = "elevation"
    EXPOSURE = "exposure"
    COVER = "cover"
    ATTENTION = "attention"
    COST = "cost"


@dataclass(frozen=True, eq=False)
class Sight:
    """pose : from which it was seen
    seen : patches by what they show, NaN where nothing is known; what the environment does not give is left
        out
    truth : the same of the true ground; attention has none
    """

    episode: int
    step: int
    pose: Pose
    seen: Mapping[Seen, np.ndarray]
    truth: Mapping[Seen, np.ndarray]


def perceived(layers: np.ndarray, attention: np.ndarray, cost: np.ndarray) -> dict[Seen, np.ndarray]:
    """Patches of what the policy had before it: the environment's layers (n, 40, 40), the attention and the
    cost map (40, 40), whose barred cells hold more than `FULL_COST`."""
    named: dict[str, np.ndarray] = dict(zip(LAYERS, layers, strict=False))
    unknown = named["unknown"] > 0.5 if "unknown" in named else np.zeros(attention.shape, bool)
    seen = {Seen.ELEVATION: np.where(unknown, np.nan, named["elevation"])}
    for wanted in (Seen.EXPOSURE, Seen.COVER):
        if wanted in named and named[wanted].any():
            seen[wanted] = named[wanted]
    seen[Seen.ATTENTION] = attention
    seen[Seen.COST] = np.where(cost > FULL_COST, np.inf, cost)
    return {name: patch.astype(np.float32) for name, patch in seen.items()}


class TrueGround:
    """What is truly about a robot in a scenario; made once an episode."""

    def __init__(self, scenario: Scenario) -> None:
        self._observers = scenario.observers
        self._heightmap = scenario.terrain.heightmap()
        self._rays = RayScene(self._heightmap, scenario.cover)
        self._blocked = blocked_cells(self._heightmap, scenario.cover)
        ground = self._heightmap
        rise = np.hypot(*np.gradient(ground.heights, ground.resolution))
        self._steepness = np.minimum(rise / math.tan(HUSKY.max_slope), 1.0)
        self._outlines = [
            thing.footprint
            for thing in scenario.cover
            if CATALOGUE[thing.kind].conceals(
                max(thing.length, thing.width), thing.height, HUSKY.width, HUSKY.height
            )
        ]

    def about(self, pose: Pose, time_s: float) -> dict[Seen, np.ndarray]:
        """Patches about a pose; NaN beyond the map."""
        points = patch_points(pose)
        ground = self._heightmap
        west, east, south, north = ground.bounds
        inside = np.all((points >= (west, south)) & (points <= (east, north)), axis=1)
        rows, cols = _cells(ground, points[inside])
        height = ground.height_at(*points[inside].T)
        elevation = np.clip(height - pose.z, -ELEVATION_LIMIT, ELEVATION_LIMIT)
        cost = np.where(self._blocked[rows, cols], np.inf, FULL_COST * self._steepness[rows, cols])
        top = np.column_stack([points[inside], height + HUSKY.height])
        values = {
            Seen.ELEVATION: elevation,
            Seen.EXPOSURE: self._exposure(top, time_s),
            Seen.COVER: self._cover(points[inside], pose),
            Seen.COST: cost,
        }
        return {name: _patch(inside, value) for name, value in values.items()}

    def _exposure(self, points: np.ndarray, time_s: float) -> np.ndarray:
        """Greatest share of light that any observer has of the points (n, 3)."""
        exposure = np.zeros(len(points))
        for view in views_at(self._observers, self._heightmap, time_s):
            held = view.holds(points)
            if held.any():
                exposure[held] = np.maximum(exposure[held], self._rays.visible(view.eye, points[held]))
        return exposure

    def _cover(self, points: np.ndarray, pose: Pose) -> np.ndarray:
        """1 in cells that reach what can hide the robot, for points (n, 2) about it."""
        cover = np.zeros(len(points))
        reach = float(np.hypot(*(points - (pose.x, pose.y)).T).max(initial=0.0))
        for outline in self._outlines:
            if math.hypot(outline.x - pose.x, outline.y - pose.y) <= reach + outline.radius:
                cover[outline.distance(points) <= 0.5 * PATCH_RESOLUTION] = 1.0
        return cover


def _cells(ground: Heightmap, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cols = np.rint((points[:, 0] - ground.x_min) / ground.resolution).astype(int)
    rows = np.rint((points[:, 1] - ground.y_min) / ground.resolution).astype(int)
    return np.clip(rows, 0, ground.shape[0] - 1), np.clip(cols, 0, ground.shape[1] - 1)


def _patch(inside: np.ndarray, values: np.ndarray) -> np.ndarray:
    patch = np.full(PATCH_CELLS * PATCH_CELLS, np.nan, np.float32)
    patch[inside] = values
    return patch.reshape(PATCH_CELLS, PATCH_CELLS)
