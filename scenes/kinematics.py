"""A Husky without rigid bodies: a unicycle with the drive's limits, lag and slip, fitted to the physics.

Its pose is that of wheels on the ground, it is stopped by what it runs into, and it tips over where it would
stand too steeply. How well it agrees with `scenes.physics.World`, and where the numbers come from:
`scenes.kinematic_fit`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from scipy.spatial import ConvexHull

from scenes.catalogue import Footprint
from scenes.drive import TRACK_FACTOR, clipped
from scenes.husky import AXLE_X, AXLE_Y, MASS_CENTRE, WHEEL_RADIUS, WHEEL_WIDTH
from scenes.kinematic_kernel import (
    AT_THE_BORDER,
    DRIVEN,
    REFERENCE_V,
    SPEED,
    STATE_SIZE,
    TURNED,
    YAW,
    YAW_RATE,
    X,
    Y,
    drive,
)
from scenes.meshes import CollisionBox, CollisionCylinder, collision_shape, cover_pose
from scenes.pose import Pose, Twist, wrap_angle
from scenes.robot import HUSKY
from scenes.scenario import CoverObject, MovingObstacle, Start
from scenes.stance import standing_pose
from scenes.terrain import Heightmap
from scenes.world import Contact, RobotLostError

STEP_S = 1.0 / 40.0
OBSTACLE_STEPS = 2  # moving obstacles are put where their beats have them at 20 Hz
TIPPING_ROLL = math.atan2(AXLE_Y + 0.5 * WHEEL_WIDTH, MASS_CENTRE[2])
TIPPING_PITCH = math.atan2(AXLE_X, MASS_CENTRE[2])
"""Radians at which the mass centre stands over the outermost wheels' contact: beyond, it tips over."""

_LIMITS = (HUSKY.max_acceleration, HUSKY.max_yaw_acceleration)
_BODY = (0.5 * HUSKY.length, AXLE_Y + 0.5 * WHEEL_WIDTH, AXLE_X, AXLE_Y)


@dataclass(frozen=True)
class Response:
    """How the robot answers to its drive.

    speed_lag : seconds of a first-order lag of the speed behind the reference, which keeps to the
        acceleration limits; the yaw rate has none
    speed_gain, yaw_gain : of the reference that is reached
    slide_turning, slide_driving : metres that it slides down a unit of slope across, a radian turned and a
        metre driven
    side_slip : metres that it slides out of a bend, a metre driven and rad/s turned
    """

    speed_lag: float
    speed_gain: float
    yaw_gain: float
    slide_turning: float
    slide_driving: float
    side_slip: float


HUSKY_RESPONSE = Response(
    speed_lag=0.0442,
    speed_gain=1.008,
    yaw_gain=1.023,
    slide_turning=1.276,
    slide_driving=0.0617,
    side_slip=0.1347,
)
"""By `python -m scenes.kinematic_fit`: half of 160 random drives of 5 s in physics, 40 on each terrain. On
the other half the model is 3 to 4 cm and 2° off after a second on the median, and 6 to 9 cm and 2° after
2.5 s, least on normal ground and most in the forest; one in ten is off by 7 to 10 cm and 14 to 22 cm."""


@dataclass(frozen=True, eq=False)
class Outlines:
    """What the robot can meet of k cover objects, as convex outlines on the ground, in the world: `corners`
    (k, n, 2) padded, of which `counts` (k,) are valid; a single one is the middle of a disc of `radii` (k,).
    """

    corners: np.ndarray
    counts: np.ndarray
    radii: np.ndarray

    @classmethod
    def of(cls, heightmap: Heightmap, cover: Sequence[CoverObject]) -> Outlines:
        outlines = [_outline(heightmap, thing) for thing in cover]
        most = max((len(points) for points, _ in outlines), default=1)
        corners = np.zeros((len(outlines), most, 2))
        for row, (points, _) in zip(corners, outlines, strict=True):
            row[: len(points)] = points
        counts = np.array([len(points) for points, _ in outlines], np.int64)
        return cls(corners, counts, np.array([radius for _, radius in outlines], float))

    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Middles (k, 2) and radii (k,) of circles about the outlines."""
        valid = np.arange(self.corners.shape[1]) < self.counts[:, None]
        middles = (self.corners * valid[..., None]).sum(axis=1) / self.counts[:, None]
        away = np.linalg.norm(self.corners - middles[:, None], axis=2) * valid
        return middles, away.max(axis=1, initial=0.0) + self.radii

    def some(self, chosen: np.ndarray) -> Outlines:
        return Outlines(self.corners[chosen], self.counts[chosen], self.radii[chosen])


NOTHING = Outlines(np.zeros((0, 1, 2)), np.zeros(0, np.int64), np.zeros(0))


def advance(
    heightmap: Heightmap,
    state: np.ndarray,
    command: Twist,
    steps: int,
    response: tuple[float, ...],
    standing: Outlines = NOTHING,
) -> int:
    """Move a state, as `scenes.kinematic_kernel` lays it out, on by `steps` of `STEP_S`, in place. Returns
    the index of the outline that was run into, `FREE` or `AT_THE_BORDER`."""
    return drive(
        state, (command.v, command.w), _LIMITS, response, steps, STEP_S,
        heightmap.heights, heightmap.resolution, heightmap.x_min, heightmap.y_min, _BODY,
        standing.corners, standing.counts, standing.radii,
    )  # fmt: skip


class KinematicWorld:
    """The same to sense, judge and drive as `scenes.physics.World`: see `scenes.world.DrivenWorld`.

    A robot that has run into something stands where it was last free; one that has tipped over lies still.
    """

    def __init__(
        self,
        heightmap: Heightmap,
        cover: Sequence[CoverObject] = (),
        obstacles: Sequence[MovingObstacle] = (),
        start: Start | None = None,
        *,
        time_s: float = 0.0,
        response: Response | None = None,
        outlines: Outlines | None = None,
    ):
        """As `scenes.physics.World`; `outlines` of the cover, where they are at hand, spare making them.

        Raises ValueError for heights or positions that are no numbers or off the map."""
        if not np.isfinite(heightmap.heights).all():
            raise ValueError("the heightmap holds heights that are not finite; fill missing cells first")
        self.heightmap = heightmap
        self._response = astuple(response or HUSKY_RESPONSE)
        self._steps = round(time_s / STEP_S)
        self._touching: tuple[Contact, ...] = ()
        self._cover = tuple(cover)
        self._stand(outlines or Outlines.of(heightmap, self._cover))
        self.set_obstacles(obstacles)
        start = start or Start(x=0.0, y=0.0)
        self.place_robot(start.x, start.y, math.radians(start.yaw))

    def __enter__(self) -> KinematicWorld:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Nothing to free; for `DrivenWorld`."""

    # --- what is ---------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        return self._steps * STEP_S

    @property
    def pose(self) -> Pose:
        return self._pose

    @property
    def twist(self) -> Twist:
        return Twist(float(self._state[SPEED]), float(self._state[YAW_RATE]))

    @property
    def up(self) -> float:
        """1 upright; negative once it has tipped over."""
        upright = math.cos(self._pose.roll) * math.cos(self._pose.pitch)
        return -upright if self._tipped else upright

    @property
    def wheel_angles(self) -> tuple[float, float, float, float]:
        turning = TRACK_FACTOR * AXLE_Y * float(self._state[TURNED])
        driven = float(self._state[DRIVEN])
        left, right = (driven - turning) / WHEEL_RADIUS, (driven + turning) / WHEEL_RADIUS
        return left, right, left, right

    def touching(self) -> tuple[Contact, ...]:
        return self._touching

    # --- what happens ----------------------------------------------------------------------------

    def step(self, command: Twist, duration_s: float) -> None:
        """Drive at `command`, within the Husky's limits of speed and acceleration, for `duration_s`.

        Raises ValueError for a command or duration that is not finite or not positive, and RobotLostError
        at the map's border.
        """
        if not (math.isfinite(command.v) and math.isfinite(command.w)):
            raise ValueError(f"the command must be finite, got v={command.v}, w={command.w}")
        if not (math.isfinite(duration_s) and duration_s >= STEP_S):
            raise ValueError(f"the duration must be at least {STEP_S:.4f} s, got {duration_s}")
        steps, done = round(duration_s / STEP_S), 0
        self._touching = ()
        wanted, near = clipped(command), self._within_reach(duration_s)
        standing = self._outlines.some(near)
        while done < steps and not self._touching and not self._tipped:
            stretch = min(OBSTACLE_STEPS, steps - done) if self._obstacles else steps - done
            met = self._drive(wanted, stretch, standing)
            done, self._steps = done + stretch, self._steps + stretch
            stood = (Contact("cover", self._cover[near[met]].id),) if met >= 0 else ()
            self._touching = stood + self._met_obstacles()
        self._steps += steps - done
        if self._touching:
            self._state[REFERENCE_V : YAW_RATE + 1] = 0.0
        x, y, yaw = self._state[: YAW + 1].tolist()
        self._pose = standing_pose(self.heightmap, x, y, float(wrap_angle(yaw)))
        self._tipped |= abs(self._pose.roll) > TIPPING_ROLL or abs(self._pose.pitch) > TIPPING_PITCH

    def _drive(self, command: Twist, steps: int, standing: Outlines) -> int:
        met = advance(self.heightmap, self._state, command, steps, self._response, standing)
        if met == AT_THE_BORDER:
            x, y = self._state[:2].tolist()
            raise RobotLostError(f"the robot left the world at ({x:.2f}, {y:.2f}) after {self.time_s:.2f} s")
        return met

    def _met_obstacles(self) -> tuple[Contact, ...]:
        """Moving obstacles that the robot's outline meets now."""
        if not self._obstacles:
            return ()
        x, y, yaw = self._state[: YAW + 1].tolist()
        robot = Footprint(x, y, yaw, HUSKY.length, HUSKY.width, round=False)
        met = []
        for obstacle in self._obstacles:
            outline = obstacle.footprint_at(self.time_s)
            near = math.hypot(outline.x - x, outline.y - y) <= outline.radius + HUSKY.circumscribed_radius
            if near and robot.gap(outline) <= 0.0:
                met.append(Contact("obstacle", obstacle.id))
        return tuple(met)

    def _within_reach(self, duration_s: float) -> np.ndarray:
        """Indices of the cover that the robot could come to meet."""
        reach = HUSKY.circumscribed_radius + HUSKY.max_speed * duration_s + 0.5
        middles, radii = self._extent
        away = np.hypot(middles[:, 0] - self._state[X], middles[:, 1] - self._state[Y])
        return np.flatnonzero(away < reach + radii)

    def place_robot(self, x: float, y: float, yaw: float) -> None:
        """Stand the robot still on the ground at (x, y), facing `yaw`, all wheels down. Takes no time.

        Raises ValueError where a number is not finite or the place is off the map or inside cover.
        """
        if not all(map(math.isfinite, (x, y, yaw))):
            raise ValueError(f"the robot's place must be finite, got x={x}, y={y}, yaw={yaw}")
        if not self.heightmap.contains(x, y):
            raise ValueError(f"the robot cannot be placed at ({x:g}, {y:g}): that is off the map")
        for thing in self._cover:
            near = math.hypot(thing.x - x, thing.y - y) <= thing.footprint.radius
            if near and thing.footprint.distance(np.array([[x, y]]))[0] < 0.0:
                what = f"{thing.kind.value} {thing.id}"
                raise ValueError(f"the robot cannot be placed at ({x:g}, {y:g}): that is inside {what}")
        self._state = np.zeros(STATE_SIZE)
        self._state[: YAW + 1] = x, y, yaw
        self._pose = standing_pose(self.heightmap, x, y, yaw)
        self._tipped = False
        self._touching = ()

    # --- what stands in it -----------------------------------------------------------------------

    def set_cover(self, cover: Sequence[CoverObject]) -> None:
        """Replace the cover objects."""
        self._cover = tuple(cover)
        self._stand(Outlines.of(self.heightmap, self._cover))

    def _stand(self, outlines: Outlines) -> None:
        self._outlines, self._extent = outlines, outlines.reach()

    def set_obstacles(self, obstacles: Sequence[MovingObstacle]) -> None:
        """Replace the moving obstacles; they go on with their beats at the world's time."""
        self._obstacles = tuple(obstacles)


def _outline(heightmap: Heightmap, thing: CoverObject) -> tuple[np.ndarray, float]:
    """Corners (n, 2) of what the robot meets of a cover object, and by how much they are grown."""
    shape, pose = collision_shape(thing), cover_pose(heightmap, thing)
    if isinstance(shape, CollisionCylinder):
        return np.array([[thing.x, thing.y]]), shape.radius
    if isinstance(shape, CollisionBox):
        return thing.footprint.corners, 0.0
    low = shape.points[shape.points[:, 2] <= HUSKY.height]
    points = pose.to_world(low if len(low) >= 3 else shape.points)[:, :2]
    return points[ConvexHull(points).vertices], 0.0
