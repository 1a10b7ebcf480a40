"""The pybullet world: ground, cover and moving obstacles as bodies, and the Husky that drives among them.

World frame, metres, seconds, radians. The only module that knows pybullet.
"""

from __future__ import annotations

import importlib
import math
import os
import sys
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from scenes.bodies import add_cover, add_ground, add_husky, add_obstacle, add_walls
from scenes.drive import DriveState, clipped, drive
from scenes.husky import MASS_CENTRE
from scenes.pose import Pose, Twist
from scenes.robot import HUSKY
from scenes.scenario import CoverObject, MovingObstacle, Start
from scenes.stance import standing_pose
from scenes.terrain import Heightmap
from scenes.world import Contact, RobotLostError


def _import_pybullet():
    """pybullet greets on standard error when it is loaded, where our refusals are one line."""
    sys.stderr.flush()
    keep = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        return importlib.import_module("pybullet")
    finally:
        os.dup2(keep, 2)
        os.close(keep)
        os.close(sink)


bullet = _import_pybullet()

STEP_S = 1.0 / 240.0
WHEEL_TORQUE = 30.0
"""N·m that one wheel can bring to bear: enough to slide all four, as the real drive can."""

SETTLING_STEPS = 60
OBSTACLE_STEPS = 4  # moving obstacles are put where their beats have them at 60 Hz
RAY_BATCH = 8192  # rayTestBatch answers one ray too few for exactly 16,384


@dataclass(frozen=True, eq=False)
class WorldState:
    """A moment to come back to, in the world that made it; forgotten by Bullet when this is dropped."""

    bullet_state: int
    revision: int
    steps: int
    drive: DriveState
    touching: tuple[Contact, ...]


class _Client:
    """pybullet's functions bound to one connection of its own, so that worlds never disturb each other."""

    def __init__(self) -> None:
        self._id = bullet.connect(bullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        value = getattr(bullet, name)
        if callable(value):
            value = partial(value, physicsClientId=self._id)
        setattr(self, name, value)  # found at once the next time
        return value


class World:
    """The physics of one scenario, in a pybullet client of its own.

    heightmap : the ground; walls stand along its outermost samples
    cover, obstacles : what the robot can run into; observers are not bodies
    start : where the robot stands at first
    cover_meshes : cover collides by its full mesh, crowns too, as `scenes.rays` sees it: for comparing
        ray casts and images with Bullet's own, not for driving
    time_s : when it begins; moving obstacles are where their beats have them then

    Raises ValueError for heights or positions that are no numbers or off the map.
    """

    def __init__(
        self,
        heightmap: Heightmap,
        cover: Sequence[CoverObject] = (),
        obstacles: Sequence[MovingObstacle] = (),
        start: Start | None = None,
        *,
        cover_meshes: bool = False,
        time_s: float = 0.0,
    ):
        if not np.isfinite(heightmap.heights).all():
            raise ValueError("the heightmap holds heights that are not finite; fill missing cells first")
        self.heightmap = heightmap
        self._cover_meshes = cover_meshes
        self._bullet = _Client()
        self._closed = weakref.finalize(self, self._bullet.disconnect)
        self._cover: dict[int, tuple[CoverObject, int]] = {}
        self._obstacles: tuple[tuple[MovingObstacle, int], ...] = ()
        self._steps = round(time_s / STEP_S)
        self._revision = 0  # of cover and obstacles
        self._drive = DriveState()
        self._touching: tuple[Contact, ...] = ()
        self._pose: Pose | None = None  # once somebody has asked for it
        self._bullet.setGravity(0.0, 0.0, -9.81)
        self._bullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            deterministicOverlappingPairs=1,
            enableConeFriction=0,  # with it, friction of a turning wheel depends on its heading
        )
        self._ground = add_ground(self._bullet, heightmap, seen=cover_meshes)
        add_walls(self._bullet, heightmap)
        self._robot, self._wheels = add_husky(self._bullet)
        self.set_cover(cover)
        self.set_obstacles(obstacles)
        start = start or Start(x=0.0, y=0.0)
        self.place_robot(start.x, start.y, math.radians(start.yaw))

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the client; safe to call twice."""
        self._closed()

    # --- what is ---------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Simulated seconds."""
        return self._steps * STEP_S

    @property
    def pose(self) -> Pose:
        """The true `pose_world_base`, base frame as in `scenes.robot`."""
        if self._pose is None:
            centre, quaternion = self._centre_pose()
            rotation = np.array(self._bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
            self._pose = Pose.from_quaternion(np.asarray(centre) - rotation @ MASS_CENTRE, quaternion)
        return self._pose

    @property
    def twist(self) -> Twist:
        """True forward speed of the base and its rate of turn about the body's up axis."""
        _, quaternion = self._centre_pose()
        return self._twist(self._bullet.getMatrixFromQuaternion(quaternion))

    @property
    def up(self) -> float:
        """The z part of the body's up axis: 1 upright, negative on its back."""
        return self._bullet.getMatrixFromQuaternion(self._centre_pose()[1])[8]

    @property
    def wheel_angles(self) -> tuple[float, float, float, float]:
        """Radians turned: front left, front right, rear left, rear right."""
        states = self._bullet.getJointStates(self._robot, self._wheels)
        front_left, front_right, rear_left, rear_right = (state[0] for state in states)
        return front_left, front_right, rear_left, rear_right

    def touching(self) -> tuple[Contact, ...]:
        """Cover and obstacles that the robot touched during the last `step`, each once."""
        return self._touching

    def _centre_pose(self):
        return self._bullet.getBasePositionAndOrientation(self._robot)

    def _twist(self, matrix) -> Twist:
        (vx, vy, vz), (wx, wy, wz) = self._bullet.getBaseVelocity(self._robot)
        w = wx * matrix[2] + wy * matrix[5] + wz * matrix[8]
        sideways = wx * matrix[1] + wy * matrix[4] + wz * matrix[7]
        v = vx * matrix[0] + vy * matrix[3] + vz * matrix[6]
        # The speed is the base's, not the mass centre's: v_base = v_centre - omega x offset.
        return Twist(v - (sideways * MASS_CENTRE[2] - w * MASS_CENTRE[1]), w)

    # --- what happens ----------------------------------------------------------------------------

    def step(self, command: Twist, duration_s: float) -> None:
        """Drive at `command`, within the Husky's limits of speed and acceleration, for `duration_s`.

        Raises ValueError for a command or duration that is not finite or not positive, and RobotLostError
        where the robot has left the world.
        """
        if not (math.isfinite(command.v) and math.isfinite(command.w)):
            raise ValueError(f"the command must be finite, got v={command.v}, w={command.w}")
        if not (math.isfinite(duration_s) and duration_s >= STEP_S):
            raise ValueError(f"the duration must be at least {STEP_S:.4f} s, got {duration_s}")
        command = clipped(command)
        steps = round(duration_s / STEP_S)
        near = self._within_reach(duration_s)
        self._pose = None
        touched: dict[int, Contact] = {}
        for _ in range(steps):
            if self._steps % OBSTACLE_STEPS == 0:
                # What has run into the robot does not go on through it.
                self._place(pair for pair in self._walking if pair[1] not in touched)
            self._turn_wheels(command)
            self._bullet.stepSimulation()
            self._steps += 1
            for body, contact in near.items():
                if body not in touched and self._touches(body):
                    touched[body] = contact
        self._touching = tuple(touched.values())
        self._check_robot()

    def _touches(self, body: int) -> bool:
        # Bullet also keeps pairs that are only near; their distance is positive.
        return any(point[8] <= 0.0 for point in self._bullet.getContactPoints(self._robot, body))

    def _turn_wheels(self, command: Twist) -> None:
        matrix = self._bullet.getMatrixFromQuaternion(self._centre_pose()[1])
        self._drive, left, right = drive(self._drive, command, self._twist(matrix), STEP_S)
        self._bullet.setJointMotorControlArray(
            self._robot,
            self._wheels,
            self._bullet.VELOCITY_CONTROL,
            targetVelocities=(left, right, left, right),
            forces=(WHEEL_TORQUE,) * 4,
        )

    def _within_reach(self, duration_s: float) -> dict[int, Contact]:
        """Bodies that the robot could come to touch, so that only those are asked for contacts."""
        pose = self.pose
        reach = HUSKY.circumscribed_radius + HUSKY.max_speed * duration_s + 0.5
        centres, radii = self._cover_extent
        close = np.hypot(centres[:, 0] - pose.x, centres[:, 1] - pose.y) < reach + radii
        standing = list(self._cover.values())
        near = {}
        for index in np.flatnonzero(close):
            thing, body = standing[index]
            near[body] = Contact("cover", thing.id)
        for obstacle, body in self._obstacles:
            outline = obstacle.footprint_at(self.time_s)
            stride = obstacle.patrol.speed * duration_s if obstacle.patrol else 0.0
            gap = math.hypot(outline.x - pose.x, outline.y - pose.y) - outline.radius
            if gap < reach + stride:
                near[body] = Contact("obstacle", obstacle.id)
        return near

    def _check_robot(self) -> None:
        pose = self.pose
        if not all(map(math.isfinite, (pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw))):
            raise RobotLostError(f"the robot's pose is no longer a number at {self.time_s:.2f} s")
        ground = float(self.heightmap.height_at(pose.x, pose.y))
        if not self.heightmap.contains(pose.x, pose.y) or pose.z < ground - 1.0:
            raise RobotLostError(
                f"the robot left the world at ({pose.x:.2f}, {pose.y:.2f}, {pose.z:.2f}),"
                f" where the ground is at {ground:.2f} m, {self.time_s:.2f} s into the drive"
            )

    def place_robot(self, x: float, y: float, yaw: float) -> None:
        """Stand the robot still on the ground at (x, y), facing `yaw`, all wheels down. Takes no time.

        Raises ValueError where a number is not finite or the place is off the map or inside cover.
        """
        if not all(map(math.isfinite, (x, y, yaw))):
            raise ValueError(f"the robot's place must be finite, got x={x}, y={y}, yaw={yaw}")
        if not self.heightmap.contains(x, y):
            raise ValueError(f"the robot cannot be placed at ({x:g}, {y:g}): that is off the map")
        for thing, _ in self._cover.values():
            if thing.footprint.distance(np.array([[x, y]]))[0] < 0.0:
                what = f"{thing.kind.value} {thing.id}"
                raise ValueError(f"the robot cannot be placed at ({x:g}, {y:g}): that is inside {what}")
        pose = standing_pose(self.heightmap, x, y, yaw)
        self._bullet.resetBasePositionAndOrientation(
            self._robot, pose.to_world(np.array(MASS_CENTRE)), pose.quaternion
        )
        self._bullet.resetBaseVelocity(self._robot, (0, 0, 0), (0, 0, 0))
        for wheel in self._wheels:
            self._bullet.resetJointState(self._robot, wheel, 0.0, 0.0)
        self._drive = DriveState()
        self._touching = ()
        self._pose = None
        for _ in range(SETTLING_STEPS):
            self._turn_wheels(Twist())
            self._bullet.stepSimulation()
        self._drive = DriveState()
        self._check_robot()

    # --- what stands in it -----------------------------------------------------------------------

    def set_cover(self, cover: Sequence[CoverObject]) -> None:
        """Replace the cover objects; those that stay as they are keep their bodies."""
        wanted = {thing.id: thing for thing in cover}
        self._revision += 1
        for key, (thing, body) in list(self._cover.items()):
            if wanted.get(key) != thing:
                self._bullet.removeBody(body)
                del self._cover[key]
        for key, thing in wanted.items():
            if key not in self._cover:
                body = add_cover(self._bullet, self.heightmap, thing, mesh=self._cover_meshes)
                self._cover[key] = thing, body
        self._cover = {key: self._cover[key] for key in wanted}  # in the order of labels
        outlines = [thing.footprint for thing in wanted.values()]
        self._cover_extent = (
            np.array([(outline.x, outline.y) for outline in outlines]).reshape(-1, 2),
            np.array([outline.radius for outline in outlines]),
        )

    def set_obstacles(self, obstacles: Sequence[MovingObstacle]) -> None:
        """Replace the moving obstacles; they go on with their beats at the world's time."""
        self._revision += 1
        for _, body in self._obstacles:
            self._bullet.removeBody(body)
        self._obstacles = tuple((thing, add_obstacle(self._bullet, thing)) for thing in obstacles)
        self._walking = tuple(pair for pair in self._obstacles if pair[0].patrol is not None)
        self._place(self._obstacles)

    def _place(self, obstacles) -> None:
        """Put obstacles where their beats have them now."""
        for thing, body in obstacles:
            x, y, yaw = thing.pose_at(self.time_s)
            z = float(self.heightmap.height_at(x, y)) + 0.5 * thing.size[2]
            self._bullet.resetBasePositionAndOrientation(
                body, (x, y, z), (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
            )

    # --- Bullet's own eyes, for comparison with `scenes.rays` and `scenes.sensors` -----------------

    def cast_rays(
        self, origins: np.ndarray, directions: np.ndarray, max_range: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The first hit along rays (n, 3), directions of unit length, by Bullet's batched ray test: distance
        (n,) float32, inf for a miss, and label (n,) int32 as in `RayScene.bodies`, -1 for a miss and for
        what has no label there (walls, the robot)."""
        origins = np.broadcast_to(np.asarray(origins, float), np.shape(directions))
        ends = origins + max_range * np.asarray(directions, float)
        answers = []
        for begin in range(0, len(ends), RAY_BATCH):
            batch = slice(begin, begin + RAY_BATCH)
            answers += self._bullet.rayTestBatch(origins[batch].tolist(), ends[batch].tolist(), numThreads=1)
        labels = self._labels()
        body = np.array([labels.get(answer[0], -1) for answer in answers], np.int32)
        share = np.array([answer[2] for answer in answers], np.float32)
        return np.where(body >= 0, share * np.float32(max_range), np.float32(np.inf)), body

    def render_segmentation(
        self, pose_world_camera: Pose, width: int, height: int, fov_horizontal: float, max_range: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bullet's software renderer, in a world with `cover_meshes`: depth (height, width) float32 along the
        optical axis, inf where nothing is, and labels (height, width) int32 as in `RayScene.bodies`, -1 for
        the rest."""
        near = 0.05
        rotation = pose_world_camera.rotation
        eye = pose_world_camera.position
        fov_vertical = 2.0 * math.atan(math.tan(0.5 * fov_horizontal) * height / width)
        _, _, _, buffer, segments = self._bullet.getCameraImage(
            width,
            height,
            viewMatrix=self._bullet.computeViewMatrix(eye, eye + rotation[:, 0], rotation[:, 2]),
            projectionMatrix=self._bullet.computeProjectionMatrixFOV(
                math.degrees(fov_vertical), width / height, near, max_range
            ),
            shadow=0,
            renderer=self._bullet.ER_TINY_RENDERER,
        )
        buffer = np.reshape(buffer, (height, width)).astype(float)
        depth = max_range * near / (max_range - (max_range - near) * buffer)
        labels = self._labels()
        table = np.full(max(labels) + 2, -1, np.int32)
        for body, label in labels.items():
            table[body] = label
        segments = np.reshape(segments, (height, width))
        known = (segments >= 0) & (segments < len(table) - 1) & (depth <= max_range)
        body = np.where(known, table[segments.clip(-1, len(table) - 1)], -1)
        return np.where(body >= 0, depth, np.inf).astype(np.float32), body.astype(np.int32)

    def _labels(self) -> dict[int, int]:
        """Labels in `RayScene.bodies` by Bullet's body id."""
        standing = (body for _, body in (*self._cover.values(), *self._obstacles))
        return {body: label for label, body in enumerate((self._ground, *standing))}

    # --- moments to come back to -----------------------------------------------------------------

    def save(self) -> WorldState:
        """The present moment, to the last bit, for `restore` in this same world."""
        state = WorldState(self._bullet.saveState(), self._revision, self._steps, self._drive, self._touching)
        weakref.finalize(state, _forget, self._bullet, self._closed, state.bullet_state)
        return state

    def restore(self, state: WorldState) -> None:
        """Go back to `state`; what follows is bit-identical to what followed then.

        Raises ValueError where cover or obstacles have been replaced since.
        """
        if state.revision != self._revision:
            raise ValueError("the cover or the obstacles have changed since this state was saved")
        self._bullet.restoreState(stateId=state.bullet_state)
        self._pose = None
        self._steps, self._drive, self._touching = state.steps, state.drive, state.touching


def _forget(client: _Client, closed: weakref.finalize, bullet_state: int) -> None:
    if closed.alive:
        client.removeState(bullet_state)
