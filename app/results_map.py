"""The map of a mission seen from above: painted ground with its cover, and where the watchers stand."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from app.view.ground import painted
from planner.scene_recipe import rebuilt
from planner.trajectory import Trajectory
from scenes.catalogue import CATALOGUE, Footprint
from scenes.placement import crown_outline
from scenes.scenario import CoverObject, Observer, Scenario
from scenes.terrain import Heightmap

SECTOR_POINTS, ROUND_POINTS = 40, 28
LONGEST_SIGHT = 200.0
MARGIN = 5.0  # metres about the drives


@dataclass(frozen=True)
class Watcher:
    """An observer; sector : (x, y) corners of what its range and field of view span, metres."""

    x: float
    y: float
    known: bool
    sector: tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False)
class Ground:
    """bounds : west, east, south, north in metres; picture : (height, width, 3) uint8, south first"""

    scenario: Scenario
    bounds: tuple[float, float, float, float]
    picture: np.ndarray
    watchers: tuple[Watcher, ...]

    @classmethod
    def of(cls, scenario: Scenario) -> Ground:
        heightmap = scenario.terrain.heightmap()
        picture = _with_cover(painted(heightmap), heightmap, scenario.cover)
        watchers = tuple(_watcher(observer) for observer in scenario.observers)
        return cls(scenario, _edges(heightmap), picture, watchers)

    @property
    def start(self) -> tuple[float, float]:
        return self.scenario.start.x, self.scenario.start.y

    @property
    def goal(self) -> tuple[float, float]:
        return self.scenario.goal.x, self.scenario.goal.y

    def view(self, ways: Sequence[Trajectory]) -> tuple[float, float, float, float]:
        """West, east, south, north of the square part of the map that the drives went through."""
        x = np.concatenate([[self.start[0], self.goal[0]], *(way.x for way in ways)])
        y = np.concatenate([[self.start[1], self.goal[1]], *(way.y for way in ways)])
        west, east, south, north = self.bounds
        side = min(max(np.ptp(x), np.ptp(y)) + 2.0 * MARGIN, east - west, north - south)
        left = float(np.clip(0.5 * (x.min() + x.max() - side), west, east - side))
        low = float(np.clip(0.5 * (y.min() + y.max() - side), south, north - side))
        return left, left + float(side), low, low + float(side)

    def jpeg(self) -> bytes:
        """North up."""
        with io.BytesIO() as buffer:
            Image.fromarray(self.picture[::-1]).save(buffer, "JPEG", quality=86)
            return buffer.getvalue()


class Grounds:
    """Makes grounds of recipes and keeps the last few. Raises ScenarioError where a scene cannot be made."""

    def __init__(self) -> None:
        self._made = lru_cache(maxsize=8)(lambda key: Ground.of(rebuilt(self._recipes[key])))
        self._recipes: dict[str, dict[str, Any]] = {}

    def of(self, recipe: dict[str, Any]) -> Ground:
        key = repr(recipe)
        self._recipes[key] = recipe
        try:
            return self._made(key)
        finally:
            self._recipes.pop(key, None)


def _edges(heightmap: Heightmap) -> tuple[float, float, float, float]:
    """The picture's: half a cell beyond the outermost samples."""
    west, east, south, north = heightmap.bounds
    half = 0.5 * heightmap.resolution
    return west - half, east + half, south - half, north + half


def _with_cover(picture: np.ndarray, heightmap: Heightmap, cover: tuple[CoverObject, ...]) -> np.ndarray:
    image = Image.fromarray(picture)
    west, east, south, north = _edges(heightmap)
    scale = np.array([image.width / (east - west), image.height / (north - south)])
    draw = ImageDraw.Draw(image)
    for thing in cover:
        outline = (_outline(crown_outline(thing)) - (west, south)) * scale
        colour = tuple(int(0.9 * part) for part in CATALOGUE[thing.kind].colour)
        draw.polygon([tuple(point) for point in outline.tolist()], fill=colour, outline=(20, 24, 22))
    return np.asarray(image)


def _outline(shape: Footprint) -> np.ndarray:
    """(n, 2) corners, many of a round one."""
    if not shape.round:
        return shape.corners
    turn = np.linspace(0.0, 2.0 * math.pi, ROUND_POINTS, endpoint=False)
    along, across = 0.5 * shape.length * np.cos(turn), 0.5 * shape.width * np.sin(turn)
    cos, sin = math.cos(shape.yaw), math.sin(shape.yaw)
    return np.column_stack([shape.x + cos * along - sin * across, shape.y + sin * along + cos * across])


def _watcher(observer: Observer) -> Watcher:
    here = observer.x, observer.y
    reach = min(observer.range, LONGEST_SIGHT)
    half = 0.5 * math.radians(observer.fov_horizontal)
    angles = math.radians(observer.yaw) + np.linspace(-half, half, SECTOR_POINTS)
    rim = [(here[0] + reach * math.cos(angle), here[1] + reach * math.sin(angle)) for angle in angles]
    whole = observer.fov_horizontal >= 360.0
    sector = rim if whole else [here, *rim]
    return Watcher(*here, observer.known, tuple((float(x), float(y)) for x, y in sector))
