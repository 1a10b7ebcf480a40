"""The Husky's senses: a VLP-16, a semantic RGB-D camera and wheel odometry, each with its own noise.

Sensors ask the ray scene with the true pose; what they hand on is in their own or the body's frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numba
import numpy as np

from scenes.pose import Pose, Twist, wrap_angle
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.shading import shade


@dataclass(frozen=True)
class LidarConfig:
    """Velodyne VLP-16: 16 beams from -15° to +15°, 0.9 to 100 m.

    azimuths : columns a turn. 900, every 0.4°, is what the sensor gives at 20 turns a second; at its 10
        turns a second it gives 1,800, for twice the time.
    noise : standard deviation of a range in metres (8 mm in Velodyne's public simulator)
    mount : `pose_base_sensor`
    """

    azimuths: int = 900
    beams: int = 16
    lowest: float = math.radians(-15.0)
    highest: float = math.radians(15.0)
    min_range: float = 0.9
    max_range: float = 100.0
    noise: float = 0.008
    mount: Pose = HUSKY.lidar_mount


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The returns of one turn; what returned nothing is left out.

    pose : the robot's true `pose_world_base`
    points_body : (n, 3) float32 in the robot's base frame
    ranges : (n,) float32 metres from the sensor
    body : (n,) int32 what was hit, as in `RayScene.bodies`; it stands for a segmentation of the cloud
    column, beam : (n,) int32 which azimuth, counter-clockwise from straight ahead, and which of the beams,
        from the lowest up
    """

    pose: Pose
    points_body: np.ndarray
    ranges: np.ndarray
    body: np.ndarray
    column: np.ndarray
    beam: np.ndarray

    def in_world(self, most: int) -> np.ndarray:
        """(at most `most`, 3) float32 points in the world, evenly thinned: for drawing, not for the robot."""
        thinned = self.points_body[:: max(1, math.ceil(len(self.points_body) / most))]
        return self.pose.to_world(thinned.astype(float)).astype(np.float32)


class Lidar:
    """A turning lidar. The robot does not move during a turn: it is cast at one instant."""

    def __init__(self, config: LidarConfig | None = None):
        self.config = config or LidarConfig()

    @cached_property
    def directions(self) -> np.ndarray:
        """(azimuths × beams, 3) float32 unit vectors in the base frame, from straight ahead
        counter-clockwise, lowest beam first."""
        config = self.config
        azimuth, elevation = np.meshgrid(
            np.linspace(0.0, 2.0 * np.pi, config.azimuths, endpoint=False),
            np.linspace(config.lowest, config.highest, config.beams),
            indexing="ij",
        )
        rays = np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1
        )
        return (rays.reshape(-1, 3) @ config.mount.rotation.T).astype(np.float32)

    @cached_property
    def _along_beams(self) -> np.ndarray:
        """The rays' indices beam by beam: neighbours along a beam are closer than the beams."""
        return np.arange(len(self.directions)).reshape(-1, self.config.beams).T.ravel()

    def scan(self, rays: RayScene, pose: Pose, rng: np.random.Generator) -> PointCloud:
        """One turn of a robot whose true `pose_world_base` is `pose`.

        A thing nearer than the least range swallows the beam: no return, and nothing is seen through it.
        """
        config = self.config
        origin = pose.to_world(config.mount.position)
        directions = self.directions @ pose.rows.astype(np.float32)
        hits = rays.cast(origin, directions, config.max_range, self._along_beams)
        # Every beam draws, so that the noise of one does not depend on what the others hit.
        noise = config.noise * rng.standard_normal(len(self.directions), dtype=np.float32)
        points, ranges, body, column, beam = cloud_kernel(
            hits.distance, hits.body, noise, self.directions, config.mount.position,
            np.float32(config.min_range), config.beams,
        )  # fmt: skip
        return PointCloud(pose, points, ranges, body, column, beam)


@numba.njit(cache=True)
def cloud_kernel(distance, body, noise, directions, mount, nearest, beams):
    """The rays (n,) that hit something at `nearest` or farther: points (m, 3) float32 from the middle of the
    sensor at `mount` (3,), ranges, bodies, columns and beams (m,), as `PointCloud` has them."""
    count = 0
    for i in range(len(distance)):
        count += body[i] >= 0 and distance[i] >= nearest
    points, ranges = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    hit, column, beam = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.int32)
    k = 0
    for i in range(len(distance)):
        if body[i] >= 0 and distance[i] >= nearest:
            ranges[k] = distance[i] + noise[i]
            for axis in range(3):
                points[k, axis] = mount[axis] + ranges[k] * directions[i, axis]
            hit[k], column[k], beam[k] = body[i], i // beams, i % beams
            k += 1
    return points, ranges, hit, column, beam


@dataclass(frozen=True)
class CameraConfig:
    """A semantic RGB-D camera that looks along the body's x axis at a zero mount rotation.

    fov_horizontal : radians across the image's width
    noise : of depth, standard deviation in metres at 1 m, growing with the square of depth as stereo's does
    """

    width: int = 320
    height: int = 240
    fov_horizontal: float = math.radians(87.0)
    min_range: float = 0.3
    max_range: float = 20.0
    noise: float = 0.0
    mount: Pose = HUSKY.camera_mount


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole without distortion, square pixels: u = cx + fx · right / depth, v = cy + fy · down / depth.

    Pixel (u, v) has its centre at whole numbers; (cx, cy) is the middle of the image.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True, eq=False)
class CameraImage:
    """What the camera sees; row 0 is at the top, u runs right along a row, v down.

    depth : (height, width) float32 metres along the optical axis, NaN where nothing is in range
    body : (height, width) int32 instance, as in `RayScene.bodies`, -1 where nothing is in range
    class_id : (height, width) int32 of the instance's class, -1 for ground and for nothing
    surface : (height, width) int8 index into `scenes.terrain.SURFACES` on the ground, else -1
    rgb : (height, width, 3) uint8
    pose : `pose_base_camera`, x along the optical axis, y left, z up
    """

    depth: np.ndarray
    body: np.ndarray
    class_id: np.ndarray
    surface: np.ndarray
    rgb: np.ndarray
    intrinsics: Intrinsics
    pose: Pose

    def points_body(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(n, 3) base-frame points of pixels, by their depth."""
        k = self.intrinsics
        depth = self.depth[rows, columns].astype(float)
        offsets = np.column_stack([np.ones(len(depth)), -(columns - k.cx) / k.fx, -(rows - k.cy) / k.fy])
        return self.pose.to_world(depth[:, None] * offsets)


class SemanticCamera:
    """A camera that also knows what each pixel belongs to: it stands for a segmentation network that does
    not err."""

    def __init__(self, config: CameraConfig | None = None):
        self.config = config or CameraConfig()

    @cached_property
    def intrinsics(self) -> Intrinsics:
        config = self.config
        focal = 0.5 * config.width / math.tan(0.5 * config.fov_horizontal)
        return Intrinsics(
            config.width, config.height, focal, focal, 0.5 * (config.width - 1), 0.5 * (config.height - 1)
        )

    @cached_property
    def directions(self) -> np.ndarray:
        """(height × width, 3) float32 unit vectors in the base frame, row by row."""
        k = self.intrinsics
        v, u = np.mgrid[: k.height, : k.width]
        rays = np.stack([np.ones(u.shape), -(u - k.cx) / k.fx, -(v - k.cy) / k.fy], -1).reshape(-1, 3)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return (rays @ self.config.mount.rotation.T).astype(np.float32)

    @cached_property
    def _cosines(self) -> np.ndarray:
        return self.directions @ self.config.mount.rotation[:, 0].astype(np.float32)

    def capture(self, rays: RayScene, pose: Pose, rng: np.random.Generator) -> CameraImage:
        """One image by a robot whose true `pose_world_base` is `pose`."""
        config = self.config
        shape = config.height, config.width
        origin = pose.to_world(config.mount.position)
        directions = self.directions @ pose.rows.astype(np.float32)
        hits = rays.cast(origin, directions, config.max_range / float(self._cosines.min()))
        noise = np.zeros(0, np.float32)
        if config.noise > 0.0:
            noise = np.float32(config.noise) * rng.standard_normal(len(directions), dtype=np.float32)
        shading = shade(rays, hits, origin, directions)
        depth, body, class_id = image_kernel(
            hits.distance, hits.body, shading.surface, self._cosines, noise,
            np.float32(config.min_range), np.float32(config.max_range),
            np.array([body.class_id for body in rays.bodies], np.int32),
        )  # fmt: skip
        return CameraImage(
            depth.reshape(shape),
            body.reshape(shape),
            class_id.reshape(shape),
            shading.surface.reshape(shape),
            shading.rgb.reshape(*shape, 3),
            self.intrinsics,
            config.mount,
        )


@numba.njit(cache=True)
def image_kernel(distance, body, surface, cosines, noise, low, high, classes):
    """Depth, instance and class by pixel (n,), in one pass; what is out of the camera's range is taken out of
    `surface`, too. noise : (n,) metres at 1 m, or none."""
    count = len(distance)
    depths, labels = np.empty(count, np.float32), np.empty(count, np.int32)
    class_ids = np.empty(count, np.int32)
    for i in range(count):
        depth = distance[i] * cosines[i]
        if len(noise) and body[i] >= 0:
            depth += depth * depth * noise[i]
        if body[i] >= 0 and low <= depth <= high:
            depths[i], labels[i], class_ids[i] = depth, body[i], classes[body[i]]
        else:
            depths[i], labels[i], class_ids[i], surface[i] = np.nan, -1, -1, -1
    return depths, labels, class_ids


@dataclass(frozen=True)
class OdometryConfig:
    """Standard deviations; all zero by default: the robot knows its pose.

    drift : metres of position error gathered per square root of a metre driven
    yaw_drift : radians per square root of a radian turned, and a tenth of it per square root of a metre
    position_noise, yaw_noise : metres and radians, anew at every measurement
    speed_noise, yaw_rate_noise : m/s and rad/s, anew at every measurement
    """

    drift: float = 0.0
    yaw_drift: float = 0.0
    position_noise: float = 0.0
    yaw_noise: float = 0.0
    speed_noise: float = 0.0
    yaw_rate_noise: float = 0.0


class Odometry:
    """Where the robot believes to be: right at its first measurement, then by adding up what it thinks it
    drove. Height, roll and pitch are the true ones (an altimeter and an inertial unit)."""

    def __init__(self, config: OdometryConfig | None = None):
        self.config = config or OdometryConfig()
        self.reset()

    def reset(self) -> None:
        """Know the pose again at the next measurement, as after the robot has been put somewhere."""
        self._last: Pose | None = None
        self._error = np.zeros(3)

    def measure(self, pose: Pose, twist: Twist, rng: np.random.Generator) -> tuple[Pose, Twist]:
        """The estimated `pose_world_base` and twist for the true ones."""
        draws = rng.standard_normal(8)
        if self._last is not None:
            self._drift(pose, draws[:3])
        self._last = pose
        config = self.config
        error = self._error + draws[3:6] * (config.position_noise, config.position_noise, config.yaw_noise)
        if not error.any() and not config.speed_noise and not config.yaw_rate_noise:
            return pose, twist
        yaw = float(wrap_angle(pose.yaw + error[2]))
        estimate = replace(pose, x=pose.x + float(error[0]), y=pose.y + float(error[1]), yaw=yaw)
        v = twist.v + config.speed_noise * float(draws[6])
        w = twist.w + config.yaw_rate_noise * float(draws[7])
        return estimate, Twist(v, w)

    def _drift(self, pose: Pose, draws: np.ndarray) -> None:
        assert self._last is not None
        step = pose.position[:2] - self._last.position[:2]
        driven, turned = float(np.hypot(*step)), abs(float(wrap_angle(pose.yaw - self._last.yaw)))
        # What is driven under a wrong heading goes astray by that angle.
        cos, sin = math.cos(self._error[2]), math.sin(self._error[2])
        astray = np.array([cos * step[0] - sin * step[1], sin * step[0] + cos * step[1]]) - step
        self._error[:2] += astray + self.config.drift * math.sqrt(driven) * draws[:2]
        self._error[2] += self.config.yaw_drift * (math.sqrt(turned) + 0.1 * math.sqrt(driven)) * draws[2]
