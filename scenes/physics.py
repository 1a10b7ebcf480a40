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

from scenes.bodies import add_ground, add_husky, add_walls
from scenes.bullet_eyes import BulletEyes
from scenes.drive import DriveState, clipped, drive
from scenes.husky import MASS_CENTRE
from scenes.pose import Pose, Twist
from scenes.scenario import CoverObject, MovingObstacle, Start
from scenes.stance import standing_pose
from scenes.standing import Standing
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
        self._bullet = _Client()
        self._closed = weakref.finalize(self, self._bullet.disconnect)
        self._standing = Standing(self._bullet, heightmap, meshes=cover_meshes)
        self._steps = round(time_s / STEP_S)
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
        near = self._standing.within_reach(self.pose, self.time_s, duration_s)
        self._pose = None
        touched: dict[int, Contact] = {}
        for _ in range(steps):
            if self._steps % OBSTACLE_STEPS == 0:
                # What has run into the robot does not go on through it.
                self._standing.walk(self.time_s, touched)
            self._turn_wheels(command)
            self._bullet.stepSimulation()
            self._steps += 1
            for body, contact in near.items():
                if body not in touched and self._standing.touches(self._robot, body):
                    touched[body] = contact
        self._touching = tuple(touched.values())
        self._check_robot()

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
        inside = self._standing.cover_at(x, y)
        if inside is not None:
            what = f"{inside.kind.value} {inside.id}"
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
        self._standing.set_cover(cover)

    def set_obstacles(self, obstacles: Sequence[MovingObstacle]) -> None:
        """Replace the moving obstacles; they go on with their beats at the world's time."""
        self._standing.set_obstacles(obstacles, self.time_s)

    @property
    def eyes(self) -> BulletEyes:
        """Bullet's own, for comparison with `scenes.rays` and `scenes.sensors`."""
        bodies = (self._ground, *self._standing.bodies)
        return BulletEyes(self._bullet, {body: label for label, body in enumerate(bodies)})

    # --- moments to come back to -----------------------------------------------------------------

    def save(self) -> WorldState:
        """The present moment, to the last bit, for `restore` in this same world."""
        bullet_state, revision = self._bullet.saveState(), self._standing.revision
        state = WorldState(bullet_state, revision, self._steps, self._drive, self._touching)
        weakref.finalize(state, _forget, self._bullet, self._closed, state.bullet_state)
        return state

    def restore(self, state: WorldState) -> None:
        """Go back to `state`; what follows is bit-identical to what followed then.

        Raises ValueError where cover or obstacles have been replaced since.
        """
        if state.revision != self._standing.revision:
            raise ValueError("the cover or the obstacles have changed since this state was saved")
        self._bullet.restoreState(stateId=state.bullet_state)
        self._pose = None
        self._steps, self._drive, self._touching = state.steps, state.drive, state.touching


def _forget(client: _Client, closed: weakref.finalize, bullet_state: int) -> None:
    if closed.alive:
        client.removeState(bullet_state)
