"""Cover and moving obstacles as bodies in a physics client: what the robot can run into."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from typing import Any

import numpy as np

from scenes.bodies import add_cover, add_obstacle
from scenes.pose import Pose
from scenes.robot import HUSKY
from scenes.scenario import CoverObject, MovingObstacle
from scenes.terrain import Heightmap
from scenes.world import Contact


class Standing:
    """What stands and walks in a `scenes.physics.World`.

    client : of that world, with its ground in it
    meshes : cover collides by its full mesh
    revision : counts how often something has been replaced
    """

    def __init__(self, client: Any, heightmap: Heightmap, *, meshes: bool = False) -> None:
        self._client, self._heightmap, self._meshes = client, heightmap, meshes
        self._cover: dict[int, tuple[CoverObject, int]] = {}
        self._obstacles: tuple[tuple[MovingObstacle, int], ...] = ()
        self.revision = 0

    @property
    def bodies(self) -> tuple[int, ...]:
        """Bullet's ids in the order of `RayScene.bodies`."""
        return tuple(body for _, body in (*self._cover.values(), *self._obstacles))

    def set_cover(self, cover: Sequence[CoverObject]) -> None:
        """Replace the cover objects; those that stay as they are keep their bodies."""
        wanted = {thing.id: thing for thing in cover}
        self.revision += 1
        for key, (thing, body) in list(self._cover.items()):
            if wanted.get(key) != thing:
                self._client.removeBody(body)
                del self._cover[key]
        for key, thing in wanted.items():
            if key not in self._cover:
                self._cover[key] = thing, add_cover(self._client, self._heightmap, thing, mesh=self._meshes)
        self._cover = {key: self._cover[key] for key in wanted}  # in the order of labels
        outlines = [thing.footprint for thing in wanted.values()]
        self._extent = (
            np.array([(outline.x, outline.y) for outline in outlines]).reshape(-1, 2),
            np.array([outline.radius for outline in outlines]),
        )

    def set_obstacles(self, obstacles: Sequence[MovingObstacle], time_s: float) -> None:
        """Replace the moving obstacles; each stands where its beat has it at `time_s`."""
        self.revision += 1
        for _, body in self._obstacles:
            self._client.removeBody(body)
        self._obstacles = tuple((thing, add_obstacle(self._client, thing)) for thing in obstacles)
        self._walking = tuple(pair for pair in self._obstacles if pair[0].patrol is not None)
        self._place(self._obstacles, time_s)

    def walk(self, time_s: float, held: Container[int]) -> None:
        """Put those with a beat where it has them at `time_s`, but for the bodies that are `held`."""
        self._place((pair for pair in self._walking if pair[1] not in held), time_s)

    def _place(self, obstacles: Iterable[tuple[MovingObstacle, int]], time_s: float) -> None:
        for thing, body in obstacles:
            x, y, yaw = thing.pose_at(time_s)
            z = float(self._heightmap.height_at(x, y)) + 0.5 * thing.size[2]
            self._client.resetBasePositionAndOrientation(
                body, (x, y, z), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
            )

    def cover_at(self, x: float, y: float) -> CoverObject | None:
        """The cover object inside whose outline (x, y) is."""
        here = np.array([[x, y]])
        things = (thing for thing, _ in self._cover.values())
        return next((thing for thing in things if thing.footprint.distance(here)[0] < 0.0), None)

    def within_reach(self, pose: Pose, time_s: float, duration_s: float) -> dict[int, Contact]:
        """Bodies that a robot at `pose` could come to touch, so that only those are asked for contacts."""
        reach = HUSKY.circumscribed_radius + HUSKY.max_speed * duration_s + 0.5
        centres, radii = self._extent
        close = np.hypot(centres[:, 0] - pose.x, centres[:, 1] - pose.y) < reach + radii
        standing = list(self._cover.values())
        near = {}
        for index in np.flatnonzero(close):
            thing, body = standing[index]
            near[body] = Contact("cover", thing.id)
        for obstacle, body in self._obstacles:
            outline = obstacle.footprint_at(time_s)
            stride = obstacle.patrol.speed * duration_s if obstacle.patrol else 0.0
            gap = math.hypot(outline.x - pose.x, outline.y - pose.y) - outline.radius
            if gap < reach + stride:
                near[body] = Contact("obstacle", obstacle.id)
        return near

    def touches(self, robot: int, body: int) -> bool:
        """Whether the robot touches a body now."""
        # Bullet also keeps pairs that are only near; their distance is positive.
        return any(point[8] <= 0.0 for point in self._client.getContactPoints(robot, body))
