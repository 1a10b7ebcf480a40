"""Where the viewer's eye is: the opening view along the drive, from above, behind the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import viser

from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import Scenario
from scenes.terrain import Heightmap

FIELD_OF_VIEW = math.radians(42.0)
FOLLOW_BACK, FOLLOW_UP = 6.5, 3.6
EYES = ((0.7, 0.85), (-0.7, 0.85), (0.2, 1.0), (-0.5, 1.25), (0.5, 1.25), (0.4, 2.1), (-0.4, 2.1))
"""Where to try to look from, aside of the way and up, in lengths of the way; the first ones look best."""


@dataclass(frozen=True)
class Viewpoint:
    """World points (3,): the eye and what it looks at."""

    position: np.ndarray
    look_at: np.ndarray


def opening_view(scenario: Scenario, heightmap: Heightmap, rays: RayScene) -> Viewpoint:
    """From behind and beside the start, over the robot's way, down on the goal: from the side that hides
    the least of both, higher up where neither side will do."""
    start = np.array([scenario.start.x, scenario.start.y])
    goal = np.array([scenario.goal.x, scenario.goal.y])
    targets = np.array(
        [[*p, float(heightmap.height_at(*p)) + 0.6] for p in (start, 0.5 * (start + goal), goal)]
    )
    best, most = None, -1
    for aside, up in EYES:
        view = _beside(start, goal, aside, up, heightmap)
        seen = _in_sight(view.position, targets, rays)
        if seen > most:
            best, most = view, seen
    assert best is not None
    return best


def _beside(start: np.ndarray, goal: np.ndarray, aside: float, up: float, heightmap: Heightmap) -> Viewpoint:
    way = goal - start
    length = max(float(np.linalg.norm(way)), 1.0)
    ahead = way / length
    middle = start + 0.52 * way
    span = max(length, 12.0)
    eye = middle - 1.25 * span * ahead + aside * span * np.array([ahead[1], -ahead[0]])
    height = float(heightmap.height_at(*middle))
    floor = float(heightmap.height_at(*eye)) + 2.5
    return Viewpoint(
        np.array([*eye, max(height + up * span, floor)]), np.array([*middle, height - 0.02 * span])
    )


def _in_sight(eye: np.ndarray, targets: np.ndarray, rays: RayScene) -> int:
    offsets = targets - eye
    distances = np.linalg.norm(offsets, axis=1)
    hits = rays.cast(eye, offsets / distances[:, None], float(distances.max()))
    return int((hits.distance > distances - 0.3).sum())


def top_view(heightmap: Heightmap, centre: tuple[float, float]) -> Viewpoint:
    """From straight above, north up, the whole map in sight."""
    west, east, south, north = heightmap.bounds
    x, y = centre
    reach = 0.56 * max(east - west, north - south)
    ground = float(heightmap.heights.max())
    # a hair south of the pole: looking straight down leaves the orbit no way to know what is up
    return Viewpoint(
        np.array([x, y - 0.002 * reach, ground + reach / math.tan(0.5 * FIELD_OF_VIEW)]),
        np.array([x, y, ground]),
    )


def chase_view(pose: Pose) -> Viewpoint:
    """Behind and above the robot, looking where it goes."""
    ahead = np.array([math.cos(pose.yaw), math.sin(pose.yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return Viewpoint(pose.position - FOLLOW_BACK * ahead + FOLLOW_UP * up, pose.position + 1.2 * ahead)


class Eye:
    """One viewer's camera."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._before_top: Viewpoint | None = None
        self._followed: np.ndarray | None = None

    @property
    def following(self) -> bool:
        return self._followed is not None

    def go(self, view: Viewpoint) -> None:
        with self._client.atomic():
            self._client.camera.position = view.position
            self._client.camera.look_at = view.look_at

    def opening(self, view: Viewpoint) -> None:
        self._before_top = self._followed = None
        self.go(view)

    def toggle_top(self, view: Viewpoint) -> None:
        """Look from above, or go back to where the eye was."""
        self._followed = None
        if self._before_top is not None:
            before, self._before_top = self._before_top, None
            self.go(before)
            return
        camera = self._client.camera
        self._before_top = Viewpoint(camera.position.copy(), camera.look_at.copy())
        self.go(view)

    def toggle_follow(self, pose: Pose) -> None:
        """Go along with the robot, or stay where the eye is."""
        if self._followed is not None:
            self._followed = None
            return
        self._before_top = None
        self._followed = pose.position
        self.go(chase_view(pose))

    def keep_up(self, pose: Pose) -> None:
        """Move as the robot has moved; what the viewer orbits to meanwhile is kept."""
        if self._followed is None:
            return
        offset = pose.position - self._followed
        if np.linalg.norm(offset) < 0.01:
            return
        self._followed = pose.position
        camera = self._client.camera
        self.go(Viewpoint(camera.position + offset, camera.look_at + offset))
