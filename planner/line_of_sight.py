"""What an observer can see at a moment, and how much of the robot that is.

Metres, radians, world frame. The ground and solid things hide, trees, bushes and fences let a share of the
light through: `scenes.rays.RayScene.visible`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from planner.detection_model import DetectionModel, detection_of
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.terrain import Heightmap

SEEN = 0.5
"""Share of light from which on something counts as seen."""

_ROUNDING = 1e-9  # relative, so that a field of view of 360° has no seam


@dataclass(frozen=True)
class View:
    """An observer's eye at (x, y, z) looks along `yaw` and the horizon.

    fov_horizontal : radians, centred on `yaw`, 2π sees all round
    fov_vertical : radians, centred on the horizon, π sees straight up and down
    range : from the eye, in three dimensions
    detection : how soon the observer notices what it sees
    A field of view or a range of zero sees nothing.
    """

    observer_id: int
    x: float
    y: float
    z: float
    yaw: float
    fov_horizontal: float
    fov_vertical: float
    range: float
    detection: DetectionModel = field(default_factory=DetectionModel)

    @property
    def eye(self) -> np.ndarray:
        """(3,) world position."""
        return np.array([self.x, self.y, self.z])

    @property
    def blind(self) -> bool:
        return min(self.fov_horizontal, self.fov_vertical, self.range) <= 0.0

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(n,) bool: which of the world points (n, 3) lie within range and field of view, hidden or not."""
        if self.blind:
            return np.zeros(len(points), bool)
        offset = np.asarray(points, float) - self.eye
        level = np.hypot(offset[:, 0], offset[:, 1])
        distance = np.hypot(level, offset[:, 2])
        rise = math.sin(0.5 * min(self.fov_vertical, math.pi))
        inside = distance <= self.range
        inside &= np.abs(offset[:, 2]) <= (rise + _ROUNDING) * distance
        ahead = math.cos(self.yaw) * offset[:, 0] + math.sin(self.yaw) * offset[:, 1]
        return inside & (ahead >= (math.cos(0.5 * self.fov_horizontal) - _ROUNDING) * level)


def views_at(observers: Iterable[Observer], heightmap: Heightmap, time_s: float) -> tuple[View, ...]:
    """Every observer's view at `time_s`: patrols have moved and look along their way."""
    watching = tuple(observers)
    if not watching:
        return ()
    poses = np.array([observer.pose_at(time_s) for observer in watching])
    ground = heightmap.height_at(poses[:, 0], poses[:, 1])
    return tuple(
        View(
            observer.id,
            float(x),
            float(y),
            float(z) + observer.eye_height,
            float(yaw),
            math.radians(observer.fov_horizontal),
            math.radians(observer.fov_vertical),
            observer.range,
            detection_of(observer),
        )
        for observer, (x, y, yaw), z in zip(watching, poses, ground, strict=True)
    )


@dataclass(frozen=True, eq=False)
class VisibleFraction:
    """Shares from 0 to 1 of the robot's hull points, each weighted by the light that comes through.

    united : with every point as the observer who sees it best has it
    each : (n,) float64 for each view
    """

    united: float
    each: np.ndarray


def visible_fraction(rays: RayScene, views: Sequence[View], pose: Pose) -> VisibleFraction:
    """How much of a Husky at `pose` (of the base, in the world) the views see.

    Measured on `HUSKY.hull_points()`; moving obstacles hide where `rays` has them.
    """
    hull = pose.to_world(HUSKY.hull_points())
    light = np.zeros((len(views), len(hull)))
    for row, view in enumerate(views):
        light[row, view.holds(hull)] = 1.0
    view, point = np.nonzero(light)
    if len(view):
        eyes = np.array([view.eye for view in views])
        light[view, point] = rays.visible(eyes[view], hull[point])
    united = float(light.max(axis=0).mean()) if len(views) else 0.0
    return VisibleFraction(united, light.mean(axis=1))
