"""The data that travels: what the robot perceives, what it decides, and the frame a tick leaves behind.

Metres, seconds, radians; world frame x east, y north, z up. Arrays are not written to once handed on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any, ClassVar

import numpy as np

from scenes.catalogue import CoverKind
from scenes.pose import Pose, Twist
from scenes.scenario import Observer, ObstacleKind
from scenes.sensors import CameraImage


class Perception(StrEnum):
    """What the robot knows: its sensors' picture, or the whole truth."""

    LIDAR = "lidar"
    ORACLE = "oracle"


class Status(StrEnum):
    IDLE = "idle"
    RUNNING = "running"
    PAUSED = "paused"
    REACHED = "reached"
    COLLIDED = "collided"
    ROLLED_OVER = "rolled_over"
    TIMEOUT = "timeout"
    STUCK = "stuck"
    UNREACHABLE = "unreachable"
    STOPPED = "stopped"

    @property
    def final(self) -> bool:
        return self not in (Status.IDLE, Status.RUNNING, Status.PAUSED)


@dataclass(frozen=True)
class GridMap:
    """The robot's map about itself; world-aligned, cell [0, 0] centred at (x_min, y_min).

    elevation : (rows, cols) float32 ground height, NaN where unknown
    variance : (rows, cols) float32, of the ground height in m²
    obstacle : (rows, cols) bool, something that blocks the robot's body stands there
    overhang : (rows, cols) float32 clearance under what hangs above the ground, inf where nothing does
    span : (2, rows, cols) float32 lowest and highest height at which something stands or hangs there,
        inf and -inf where nothing does
    """

    x_min: float
    y_min: float
    resolution: float
    elevation: np.ndarray
    variance: np.ndarray
    obstacle: np.ndarray
    overhang: np.ndarray
    span: np.ndarray

    @property
    def unknown(self) -> np.ndarray:
        return np.isnan(self.elevation)

    @property
    def shape(self) -> tuple[int, int]:
        return self.elevation.shape

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """(row, col) of the cell that holds a world point; may lie outside the grid."""
        return (
            int(np.rint((y - self.y_min) / self.resolution)),
            int(np.rint((x - self.x_min) / self.resolution)),
        )

    def cells(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns (n,) of the cells that hold world points; may lie outside the grid."""
        return (
            np.rint((y - self.y_min) / self.resolution).astype(int),
            np.rint((x - self.x_min) / self.resolution).astype(int),
        )

    def contains(self, x: float, y: float) -> bool:
        row, col = self.cell(x, y)
        return 0 <= row < self.shape[0] and 0 <= col < self.shape[1]


@dataclass(frozen=True)
class Detection:
    """One object in the camera image, in the form of the paper's Listing 1; x_min <= x_max and
    y_min <= y_max in pixels, position in the world frame, kpts (k, 2) pixel corners of the mask's box."""

    frame_id: int
    class_id: int
    class_name: str
    confidence: float
    x_min: float
    y_min: float
    x_max: float
    y_max: float
    object_id: int
    x_pos: float
    y_pos: float
    z_pos: float
    kpts: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class CoverEstimate:
    """A cover object as the robot knows it: from detections over time, or from the scenario."""

    object_id: int
    kind: CoverKind
    x: float
    y: float
    z: float
    width: float
    height: float
    confidence: float


@dataclass(frozen=True)
class TrackedObstacle:
    """A moving obstacle as the robot knows it: a disc with a constant velocity."""

    object_id: int
    kind: ObstacleKind
    x: float
    y: float
    vx: float
    vy: float
    radius: float


@dataclass(frozen=True, eq=False)
class CameraView:
    """The newest image of the robot's camera, and the robot's estimated `pose_world_base` when it took it."""

    image: CameraImage
    pose: Pose


@dataclass(frozen=True)
class Percept:
    """All that a planning method may know at one tick.

    pose, twist : as estimated (odometry), not the truth
    elevation_patch : (40, 40) float32 at 0.5 m, body frame (row 0 behind-right, columns along +x forward is
        axis 1, rows along +y left is axis 0), ground height minus the robot's, unknown cells filled from
        the nearest known
    unknown_patch : (40, 40) bool, where the patch was filled
    obstacle_points : (m, 2) world points of mapped obstacle cells near the robot
    obstacle_distances : (72,) nearest mapped obstacle by bearing in the body frame, metres, inf where none
    known_observers, observer_eyes : ids, and world x, y, z of their eyes in the same order
    observers : the known ones as documents; one that was spotted stands where it was last seen
    tracks : (k, 5) sightings of each moving obstacle by its id, oldest first: seconds, world x, y, vx and vy
    view : the same object until the camera looks again; None before it has, and in the oracle's perception.
        It stays in its process: a percept that was pickled has none
    """

    time_s: float
    perception: Perception
    pose: Pose
    twist: Twist
    goal: tuple[float, float]
    grid: GridMap
    elevation_patch: np.ndarray
    unknown_patch: np.ndarray
    obstacle_points: np.ndarray
    obstacle_distances: np.ndarray
    moving: tuple[TrackedObstacle, ...] = ()
    detections: tuple[Detection, ...] = ()
    cover: tuple[CoverEstimate, ...] = ()
    known_observers: tuple[int, ...] = ()
    observer_eyes: tuple[tuple[float, float, float], ...] = ()
    observers: tuple[Observer, ...] = ()
    tracks: Mapping[int, np.ndarray] = field(default_factory=dict)
    view: CameraView | None = field(default=None, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"view": None}

    @property
    def goal_distance(self) -> float:
        return float(np.hypot(self.goal[0] - self.pose.x, self.goal[1] - self.pose.y))


class Rejection(IntEnum):
    """Why a candidate arc was not admissible."""

    NONE = 0
    COLLISION = 1
    CANNOT_STOP = 2
    MOVING_OBSTACLE = 3
    SLOPE = 4
    TILT = 5
    UNKNOWN_GROUND = 6
    OFF_THE_MAP = 7


@dataclass(frozen=True)
class Arcs:
    """The dynamic window's candidates and why each won or lost.

    v, w : (n,) velocities; poses : (n, steps, 3) predicted x, y, yaw in the world
    heading, clearance, velocity, goal, ground : (n,) weighted terms, lower total is better; ground is for
        unknown cells and tilt under the wheels
    total : (n,) sum, inf where rejected; rejection : (n,) int8 of `Rejection`
    chosen : index, or -1 where no arc was admissible
    """

    v: np.ndarray
    w: np.ndarray
    poses: np.ndarray
    heading: np.ndarray
    clearance: np.ndarray
    velocity: np.ndarray
    goal: np.ndarray
    ground: np.ndarray
    total: np.ndarray
    rejection: np.ndarray
    chosen: int


@dataclass(frozen=True)
class CostPatch:
    """A cost map drawn over the ground: (rows, cols) float32 in 0..100, inf where forbidden, NaN unknown."""

    x_min: float
    y_min: float
    resolution: float
    cost: np.ndarray


@dataclass(frozen=True, eq=False)
class Segmentation:
    """What a method takes the ground about the robot, and the camera's newest image, for. Labels are uint8
    places in `scenes.catalogue.TraversabilityGroup`, `UNKNOWN` where nothing has been seen.

    ground : (rows, cols) labels over a world-aligned grid whose cell [0, 0] is centred at (x_min, y_min)
    rgb : (h, w, 3) uint8 of the image, groups : (h, w) its labels; None for a method that was told the truth
    """

    UNKNOWN: ClassVar[int] = 255

    x_min: float
    y_min: float
    resolution: float
    ground: np.ndarray
    rgb: np.ndarray | None = None
    groups: np.ndarray | None = None


@dataclass(frozen=True)
class Decision:
    """What a method wants; `note` says in words what it is doing, `failure` ends the mission.

    belief : chance, in per cent, that an observer not yet seen sees a robot in each cell, for methods that
        heed one
    segmentation : of methods that tell ground by its looks
    """

    command: Twist
    waypoint: tuple[float, float] | None = None
    route: np.ndarray | None = None  # (k, 2) world
    cost: CostPatch | None = None
    arcs: Arcs | None = None
    cover_id: int | None = None
    note: str = ""
    failure: Status | None = None
    belief: CostPatch | None = None
    segmentation: Segmentation | None = None


@dataclass(frozen=True)
class Metrics:
    """Running totals of a drive."""

    trajectory_length_m: float = 0.0
    collisions: int = 0
    max_roll: float = 0.0
    max_pitch: float = 0.0
    cover_fraction: float = 0.0
    elevation_gradient_m: float = 0.0


@dataclass(frozen=True)
class Watch:
    """What one observer sees of the robot now (fraction, 0 to 1), and of the drive so far."""

    observer_id: int
    fraction: float = 0.0
    exposed_s: float = 0.0
    exposure_fraction: float = 0.0
    longest_exposure_s: float = 0.0
    detection_probability: float = 0.0


@dataclass(frozen=True)
class Exposure:
    """How much of the robot is seen now, by all observers together, and the totals of the drive so far.

    fraction : visible fraction, from 0 to 1; of each point, what the observer who sees it best sees
    exposed_s : integral of the fraction over time; exposure_fraction : its share of the drive's time
    longest_exposure_s : without interruption, a fraction of more than 0.05
    concealed_fraction : share of the time with a fraction of at most 0.05
    expected_detection_s : from the drive's beginning, given that it is detected; None where it cannot be
    """

    fraction: float = 0.0
    exposed_s: float = 0.0
    exposure_fraction: float = 0.0
    longest_exposure_s: float = 0.0
    concealed_fraction: float = 0.0
    detection_probability: float = 0.0
    expected_detection_s: float | None = None
    watches: tuple[Watch, ...] = ()


@dataclass(frozen=True)
class WalkerPose:
    """Where an observer or moving obstacle truly is."""

    id: int
    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class Frame:
    """One tick as it truly happened, for the view, the run store and the figures.

    scan_points : (n, 3) float32 world points of the newest lidar turn, thinned for drawing
    in_cover : Algorithm 1's answer at this tick
    planner_ms : wall time of sense, perceive and plan together; the one field that load may change
    """

    tick: int
    time_s: float
    status: Status
    pose: Pose
    twist: Twist
    wheel_angles: tuple[float, float, float, float]
    goal: tuple[float, float]
    percept: Percept | None
    decision: Decision | None
    metrics: Metrics
    observers: tuple[WalkerPose, ...] = ()
    obstacles: tuple[WalkerPose, ...] = ()
    scan_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    message: str = ""
    in_cover: bool = False
    exposure: Exposure = field(default_factory=Exposure)
    planner_ms: float = field(default=0.0, compare=False)
