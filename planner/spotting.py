"""Observers that the robot was not told of: it knows them once its sensors have seen them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from planner.line_of_sight import SEEN
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Observer
from scenes.terrain import Heightmap

SPOTTING_RANGE = 25.0
"""Metres from the lidar or the camera within which an observer in line of sight is recognised as one."""

FIGURE_MIDDLE = 0.9  # metres above the ground


class Spotter:
    """Keeps where observers that were not known beforehand (`known: false`) have last been seen.

    Lidar and camera together look all round: an observer is spotted when the line from either of their mounts
    to its eye or to the middle of its figure lets at least half of the light through. From then on it is
    known: while it is in sight, where it truly is; after that, where and how it was last seen, for nobody
    has told the robot its beat.
    """

    def __init__(self, reach: float = SPOTTING_RANGE):
        self.reach = reach
        self._spotted: dict[int, Observer] = {}

    def look(
        self, rays: RayScene, heightmap: Heightmap, pose: Pose, observers: Iterable[Observer], time_s: float
    ) -> None:
        """Look round from the true pose of the base in the world at `time_s`."""
        hidden = [observer for observer in observers if not observer.known]
        if not hidden:
            self._spotted.clear()
            return
        places = [observer.pose_at(time_s) for observer in hidden]
        eyes = np.array([observer.eye_height for observer in hidden])
        spotted = in_sight(rays, heightmap, pose, np.array(places)[:, :2], eyes, self.reach).tolist()
        still_there = {observer.id for observer in hidden}
        self._spotted = {key: value for key, value in self._spotted.items() if key in still_there}
        for observer, (x, y, yaw), now in zip(hidden, places, spotted, strict=True):
            if now:
                sighted = {"x": x, "y": y, "yaw": math.degrees(yaw), "patrol": None}
                self._spotted[observer.id] = observer.model_copy(update=sighted)

    def known(self, observers: Iterable[Observer]) -> tuple[Observer, ...]:
        """Those that the robot was told of as they are, those it has spotted as it saw them last."""
        return tuple(
            observer if observer.known else self._spotted[observer.id]
            for observer in observers
            if observer.known or observer.id in self._spotted
        )


def in_sight(
    rays: RayScene,
    heightmap: Heightmap,
    pose: Pose,
    places: np.ndarray,
    eye_heights: np.ndarray,
    reach: float = SPOTTING_RANGE,
) -> np.ndarray:
    """(n,) bool: whether a robot at `pose` (of the base, in the world) would spot somebody at places (n, 2)
    with eyes (n,) metres above the ground."""
    ground = heightmap.height_at(places[:, 0], places[:, 1])
    heights = np.concatenate([ground + eye_heights, ground + FIGURE_MIDDLE])
    targets = np.column_stack([np.tile(places, (2, 1)), heights])
    seen = np.zeros(len(targets), bool)
    for mount in (HUSKY.lidar_mount, HUSKY.camera_mount):
        sensor = pose.compose(mount).position
        near = np.flatnonzero(~seen & (np.linalg.norm(targets - sensor, axis=1) <= reach))
        seen[near] = rays.visible(np.broadcast_to(sensor, (len(near), 3)), targets[near]) >= SEEN
    eye, figure = seen.reshape(2, -1)
    return eye | figure
