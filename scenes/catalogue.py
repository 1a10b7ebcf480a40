"""The classes of cover: what each is called, how large it is, what it hides and where it blocks the way.

A new cover class is one entry in `CATALOGUE` and one mesh builder in `scenes.meshes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np


class CoverKind(StrEnum):
    TREE = "tree"
    BUSH = "bush"
    ROCK = "rock"
    COTTAGE = "cottage"
    BUILDING = "building"
    HOUSE = "house"
    DISABLED_VEHICLE = "disabled_vehicle"
    FENCE = "fence"


class TraversabilityGroup(StrEnum):
    """GA-Nav's six groups (Guan et al. 2022)."""

    BACKGROUND = "background"
    SMOOTH = "smooth"
    ROUGH = "rough"
    BUMPY = "bumpy"
    FORBIDDEN = "forbidden"
    OBSTACLE = "obstacle"


@dataclass(frozen=True)
class SizeRange:
    """Smallest, usual and largest outer dimension in metres."""

    low: float
    usual: float
    high: float


@dataclass(frozen=True)
class CoverClass:
    """One class of cover.

    class_id, class_name : canonical label of a detection (the paper's Listing 1)
    length, width, height : outer dimensions along the body's x, y and z axes
    round : True for a disc seen from above (length is the diameter of crown or bush)
    ground_fraction : share of length and width that stands on the ground (a trunk under a crown)
    opacity : share of light that one pass through the object stops
    colour : RGB, 0 to 255, of its main part
    """

    kind: CoverKind
    class_id: int
    class_name: str
    length: SizeRange
    width: SizeRange
    height: SizeRange
    round: bool
    ground_fraction: float
    opacity: float
    colour: tuple[int, int, int]
    group: TraversabilityGroup

    @property
    def opaque(self) -> bool:
        """Whether it hides more of what is behind it than it shows."""
        return self.opacity >= 0.5

    def conceals(self, width: float, height: float, robot_width: float, robot_height: float) -> bool:
        """Whether an instance of this size can hide a robot that stands behind it."""
        return self.opaque and width >= robot_width and height >= robot_height


CATALOGUE: dict[CoverKind, CoverClass] = {
    entry.kind: entry
    for entry in (
        CoverClass(
            CoverKind.TREE, 0, "tree",
            SizeRange(1.0, 3.0, 12.0), SizeRange(1.0, 3.0, 12.0), SizeRange(2.0, 6.0, 45.0),
            True, 0.12, 0.9, (58, 98, 52), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.BUSH, 1, "bush",
            SizeRange(0.4, 1.4, 6.0), SizeRange(0.4, 1.4, 6.0), SizeRange(0.3, 1.1, 3.0),
            True, 0.85, 0.8, (86, 120, 58), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.ROCK, 2, "rock",
            SizeRange(0.3, 1.2, 8.0), SizeRange(0.3, 1.0, 8.0), SizeRange(0.2, 0.8, 5.0),
            False, 0.9, 1.0, (128, 124, 116), TraversabilityGroup.BUMPY,
        ),
        CoverClass(
            CoverKind.COTTAGE, 3, "cottage",
            SizeRange(3.0, 5.0, 10.0), SizeRange(2.5, 4.0, 8.0), SizeRange(2.4, 3.6, 6.0),
            False, 1.0, 1.0, (176, 146, 110), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.BUILDING, 4, "building",
            SizeRange(4.0, 8.0, 40.0), SizeRange(4.0, 6.0, 40.0), SizeRange(2.5, 5.0, 30.0),
            False, 1.0, 1.0, (168, 168, 172), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.HOUSE, 5, "house",
            SizeRange(5.0, 8.0, 20.0), SizeRange(4.0, 6.5, 16.0), SizeRange(3.5, 5.5, 12.0),
            False, 1.0, 1.0, (196, 178, 156), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.DISABLED_VEHICLE, 6, "disabled vehicle",
            SizeRange(2.0, 4.6, 12.0), SizeRange(1.2, 1.9, 3.5), SizeRange(0.9, 1.7, 4.0),
            False, 1.0, 1.0, (104, 98, 74), TraversabilityGroup.OBSTACLE,
        ),
        CoverClass(
            CoverKind.FENCE, 7, "fence",
            SizeRange(0.5, 4.0, 40.0), SizeRange(0.05, 0.08, 0.5), SizeRange(0.5, 1.2, 3.0),
            False, 1.0, 0.35, (142, 112, 78), TraversabilityGroup.OBSTACLE,
        ),
    )
}


@dataclass(frozen=True)
class Footprint:
    """Where something stands on the ground: a disc (length is its diameter) or a rectangle.

    Metres and radians in the world frame; length along the yaw axis, width across it.
    """

    x: float
    y: float
    yaw: float
    length: float
    width: float
    round: bool

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (n,) of world points (n, 2) to the outline, negative inside."""
        offset = np.atleast_2d(points) - (self.x, self.y)
        if self.round:
            return np.hypot(offset[:, 0], offset[:, 1]) - 0.5 * self.length
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        along = np.abs(cos * offset[:, 0] + sin * offset[:, 1]) - 0.5 * self.length
        across = np.abs(-sin * offset[:, 0] + cos * offset[:, 1]) - 0.5 * self.width
        outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        return outside + np.minimum(np.maximum(along, across), 0.0)

    def gap(self, other: Footprint) -> float:
        """Metres between two outlines, negative where they overlap."""
        if self.round:
            return float(other.distance(np.array([[self.x, self.y]]))[0]) - 0.5 * self.length
        if other.round:
            return other.gap(self)
        ours, theirs = self.corners, other.corners
        separation = -np.inf
        for yaw in (self.yaw, self.yaw + 0.5 * np.pi, other.yaw, other.yaw + 0.5 * np.pi):
            axis = np.array([np.cos(yaw), np.sin(yaw)])
            a, b = ours @ axis, theirs @ axis
            separation = max(separation, a.min() - b.max(), b.min() - a.max())
        if separation < 0.0:
            return float(separation)
        return float(min(other.distance(ours).min(), self.distance(theirs).min()))

    @cached_property
    def corners(self) -> np.ndarray:
        """(4, 2) world corners of the rectangle, or of the square about the disc."""
        half_length, half_width = 0.5 * self.length, 0.5 * (self.length if self.round else self.width)
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        along = half_length * np.array([1.0, -1.0, -1.0, 1.0])
        across = half_width * np.array([1.0, 1.0, -1.0, -1.0])
        return np.column_stack([self.x + cos * along - sin * across, self.y + sin * along + cos * across])

    def lattice(self, spacing: float) -> np.ndarray:
        """(n, 2) world points over the rectangle, or over the square about the disc, edges included."""
        corner, along, _, across = self.corners[[2, 3, 0, 1]]
        steps = [max(2, int(np.ceil(np.hypot(*(end - corner)) / spacing)) + 1) for end in (along, across)]
        u, v = np.meshgrid(*(np.linspace(0.0, 1.0, count) for count in steps))
        return corner + u.reshape(-1, 1) * (along - corner) + v.reshape(-1, 1) * (across - corner)

    @cached_property
    def radius(self) -> float:
        """Radius of the circle about (x, y) that holds the outline."""
        return 0.5 * (self.length if self.round else float(np.hypot(self.length, self.width)))


def footprint(kind: CoverKind, x: float, y: float, yaw: float, length: float, width: float) -> Footprint:
    """What an instance of `kind` blocks on the ground; yaw in radians."""
    entry = CATALOGUE[kind]
    share = entry.ground_fraction
    return Footprint(x, y, yaw, share * length, share * (length if entry.round else width), entry.round)
