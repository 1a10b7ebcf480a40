"""From sensors, or from the truth, to the one `Percept` that methods decide on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit

from planner.cover import CoverMemory
from planner.detection import listed, looked_through, sight
from planner.elevation_map import ElevationMap, MapConfig, elevation_patch
from planner.foresight import TrackLog
from planner.frames import CameraView, CoverEstimate, Detection, GridMap, Percept, Perception, TrackedObstacle
from planner.ground_segmentation import Scan
from planner.oracle import TrueMap, true_cover, true_obstacles
from planner.spotting import Spotter
from planner.tracking import ObstacleTracker, locate
from scenes.pose import Pose, Twist
from scenes.rays import BodyKind, RayScene
from scenes.scenario import Observer, Scenario
from scenes.sensors import (
    CameraConfig,
    CameraImage,
    Lidar,
    LidarConfig,
    Odometry,
    PointCloud,
    SemanticCamera,
)
from scenes.terrain import SURFACES, Surface

CAMERA_PERIOD = 5
"""Ticks between images: 2 Hz beside the lidar's 10 Hz."""

OBSTACLE_RANGE, MAX_OBSTACLE_POINTS = 6.0, 400
BEARINGS = 72
MAPPED_DEPTH = 10.0  # metres: farther depths of the camera are too coarse to map
PIXEL_STRIDE = 2  # of the depth image, for the map


@dataclass(frozen=True)
class Sensing:
    """The sensors, and how often the camera looks: every `camera_period`-th time that is perceived."""

    lidar: LidarConfig = field(default_factory=LidarConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    camera_period: int = CAMERA_PERIOD


class Perceiver:
    """The robot's senses. In `Perception.LIDAR` it knows what lidar, camera and odometry tell it over time;
    in `Perception.ORACLE` it knows everything, but for observers that it was not told of: those it has to
    spot in both. Both give the same kind of `Percept`, which says which.

    `perception` may be switched at any time; what was sensed before is kept. It can be pickled, so that a
    mission can go on elsewhere from where it was.

    cloud : the newest lidar turn; None before there was one, and in the oracle's perception
    """

    def __init__(
        self,
        scenario: Scenario,
        perception: Perception = Perception.LIDAR,
        rng: np.random.Generator | None = None,
        config: MapConfig | None = None,
        sensing: Sensing | None = None,
    ):
        sensing = sensing or Sensing()
        self.perception = perception
        self.cloud: PointCloud | None = None
        seeds = np.random.default_rng(0) if rng is None else rng
        self._lidar_rng, self._camera_rng, self._odometry_rng, self._detection_rng = seeds.spawn(4)
        self._lidar, self._camera = Lidar(sensing.lidar), SemanticCamera(sensing.camera)
        self._odometry, self._camera_period = Odometry(), sensing.camera_period
        self._map = ElevationMap(scenario.start.x, scenario.start.y, config)
        self._tracker, self._memory = ObstacleTracker(), CoverMemory()
        self._log = TrackLog()
        self._spotter = Spotter()
        self._detections: tuple[Detection, ...] = ()
        self._view: CameraView | None = None
        self._tick = 0
        self._heightmap = scenario.terrain.heightmap()
        self.edit(scenario)

    def edit(self, scenario: Scenario) -> None:
        """Take over a changed scenario of the same terrain. What was sensed is left for the sensors to
        correct; the truth and the known observers change at once."""
        self._scenario = scenario
        self._truth = TrueMap(self._heightmap, scenario.cover, self._map.config)
        self._true_cover = true_cover(scenario.cover, self._heightmap)

    def perceive(
        self, rays: RayScene, pose: Pose, twist: Twist, time_s: float, goal: tuple[float, float]
    ) -> Percept:
        """What the robot knows at `time_s` when it truly stands at `pose` (of the base, in the world) and
        moves with `twist`. Call it once a tick, with walkers placed in `rays`."""
        self._spotter.look(rays, self._heightmap, pose, self._scenario.observers, time_s)
        if self.perception is Perception.ORACLE:
            self.cloud = None
            moving = true_obstacles(self._scenario.obstacles, time_s)
            grid = self._truth.about(pose.x, pose.y)
            return self._percept(time_s, pose, twist, goal, grid, moving, (), self._true_cover, None)
        estimate, measured = self._odometry.measure(pose, twist, self._odometry_rng)
        self._map.move_to(estimate.x, estimate.y)
        self._map.stand_at(estimate)
        moving = self._scan(rays, pose, estimate, time_s)
        if self._tick % self._camera_period == 0:
            self._look(rays, pose, estimate)
        self._tick += 1
        return self._percept(
            time_s, estimate, measured, goal, self._map.grid(), moving,
            self._detections, self._memory.estimates, self._view,
        )

    def _scan(self, rays: RayScene, pose: Pose, estimate: Pose, time_s: float) -> tuple[TrackedObstacle, ...]:
        cloud = self._lidar.scan(rays, pose, self._lidar_rng)
        self.cloud = cloud
        world = estimate.to_world(cloud.points_body.astype(float))
        sensor = estimate.compose(self._lidar.config.mount)
        kinds = {obstacle.id: obstacle.kind for obstacle in self._scenario.obstacles}
        sighted = []
        for body in rays.walkers:
            if body.kind is BodyKind.OBSTACLE and body.id in kinds:
                seen = locate(body.id, kinds[body.id], world[cloud.body == body.index], sensor.position)
                sighted += [] if seen is None else [seen]
        self._map.add_scan(lidar_scan(cloud, world, _still(rays), sensor, self._lidar.config), estimate)
        return self._tracker.update(time_s, sighted)

    def _look(self, rays: RayScene, pose: Pose, estimate: Pose) -> None:
        image = self._camera.capture(rays, pose, self._camera_rng)
        self._view = CameraView(image, estimate)
        sightings = sight(image, rays.bodies, estimate, self._tick, self._detection_rng)
        seen = {sighting.detection.object_id for sighting in sightings}
        unseen = [
            (cover.object_id, np.array([cover.x, cover.y, cover.z + 0.5 * cover.height]))
            for cover in self._memory.estimates
            if cover.object_id not in seen
        ]
        self._memory.update(sightings, looked_through(image, unseen, estimate))
        self._detections = listed(sightings)
        self._map.add_scan(_depth_scan(image, _still(rays), estimate), estimate)

    def _percept(
        self,
        time_s: float,
        pose: Pose,
        twist: Twist,
        goal: tuple[float, float],
        grid: GridMap,
        moving: tuple[TrackedObstacle, ...],
        detections: tuple[Detection, ...],
        cover: tuple[CoverEstimate, ...],
        view: CameraView | None,
    ) -> Percept:
        patch, unknown = elevation_patch(grid, pose)
        points = obstacle_points(grid)
        known = self._spotter.known(self._scenario.observers)
        self._log.see(time_s, moving)
        return Percept(
            time_s, self.perception, pose, twist, goal, grid, patch, unknown,
            nearest_points(points, pose), obstacle_distances(points, pose),
            moving, detections, cover, tuple(observer.id for observer in known),
            tuple(self._eye(observer, time_s) for observer in known), known, self._log.tracks(moving), view,
        )

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_view": None}  # the next look is soon, and an image is large

    def _eye(self, observer: Observer, time_s: float) -> tuple[float, float, float]:
        x, y, _ = observer.pose_at(time_s)
        return x, y, float(self._heightmap.height_at(x, y)) + observer.eye_height


def obstacle_points(grid: GridMap) -> np.ndarray:
    """(n, 2) world centres of obstacle cells, without those that other obstacle cells enclose."""
    row, col = _rims(grid.obstacle)
    return np.column_stack([grid.x_min + col * grid.resolution, grid.y_min + row * grid.resolution])


@njit(cache=True)
def _rims(blocked):
    """Rows and columns, in row order, of cells that are blocked and have a side that is not or is none."""
    rows, cols = blocked.shape
    found, count = np.empty((2, rows * cols), np.int64), 0
    for row in range(rows):
        for col in range(cols):
            if blocked[row, col] and not (
                0 < row < rows - 1
                and 0 < col < cols - 1
                and blocked[row - 1, col]
                and blocked[row + 1, col]
                and blocked[row, col - 1]
                and blocked[row, col + 1]
            ):
                found[0, count], found[1, count] = row, col
                count += 1
    return found[0, :count], found[1, :count]


def nearest_points(
    points: np.ndarray, pose: Pose, reach: float = OBSTACLE_RANGE, limit: int = MAX_OBSTACLE_POINTS
) -> np.ndarray:
    """The points (n, 2) within `reach` metres of the robot, nearest first, `limit` of them at most."""
    distance = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y)
    order = np.argsort(distance, kind="stable")[:limit]
    return points[order[distance[order] <= reach]]


def obstacle_distances(points: np.ndarray, pose: Pose) -> np.ndarray:
    """(72,) metres to the nearest point by bearing in the body frame, inf where there is none: element k
    looks along 5k degrees, counter-clockwise from straight ahead."""
    dx, dy = points[:, 0] - pose.x, points[:, 1] - pose.y
    bearing = np.rint((np.arctan2(dy, dx) - pose.yaw) / (2.0 * math.pi / BEARINGS)).astype(int) % BEARINGS
    nearest = np.full(BEARINGS, np.inf)
    np.minimum.at(nearest, bearing, np.hypot(dx, dy))
    return nearest


def _still(rays: RayScene) -> np.ndarray:
    """By body label, whether its returns belong in the map; the last element answers for a miss, -1."""
    still = np.ones(len(rays.bodies) + 1, bool)
    still[[body.index for body in rays.walkers if body.kind is BodyKind.OBSTACLE] + [-1]] = False
    return still


def lidar_scan(
    cloud: PointCloud, world: np.ndarray, still: np.ndarray, sensor: Pose, config: LidarConfig
) -> Scan:
    """The cloud in its turn's order, at world points (n, 3), without what moves."""
    points = np.full((config.azimuths, config.beams, 3), np.nan)
    _put_in_order(points, world, still, cloud.body, cloud.column, cloud.beam)
    elevations = np.linspace(config.lowest, config.highest, config.beams)
    return Scan(points, sensor, elevations, range_sigma=max(config.noise, 0.02))


@njit(cache=True)
def _put_in_order(points, world, still, body, column, beam):
    """Write the returns (n, 3) of what stays in place to where they belong in the turn."""
    for i in range(len(body)):
        if still[body[i]]:
            points[column[i], beam[i]] = world[i]


def _depth_scan(image: CameraImage, still: np.ndarray, estimate: Pose) -> Scan:
    """A thinned depth image as a scan: a column of pixels is one azimuth, its lowest pixel the first beam."""
    k = image.intrinsics
    points, wet = _thinned_depth(
        image.depth, image.body, image.surface, still, np.array([k.fx, k.fy, k.cx, k.cy]), PIXEL_STRIDE,
        np.float32(MAPPED_DEPTH), SURFACES.index(Surface.WATER),
    )  # fmt: skip
    world = estimate.to_world(image.pose.to_world(points.reshape(-1, 3)))
    return Scan(world.reshape(points.shape), estimate.compose(image.pose), wet=wet)


@njit(cache=True)
def _thinned_depth(depth, body, surface, still, lens, stride, farthest, water):
    """Every `stride`-th pixel in the camera's frame (columns, rows from below, 3), NaN where it shows nothing
    that belongs in the map, and whether it shows water. lens : (4,) fx, fy, cx, cy"""
    height, width = depth.shape
    columns, rows = (width + stride - 1) // stride, (height + stride - 1) // stride
    points, wet = np.empty((columns, rows, 3)), np.empty((columns, rows), np.bool_)
    for c in range(columns):
        col = c * stride
        for r in range(rows):
            row = height - 1 - r * stride
            wet[c, r] = surface[row, col] == water
            ahead = np.nan
            if depth[row, col] <= farthest and still[body[row, col]]:
                ahead = np.float64(depth[row, col])
            points[c, r, 0] = ahead
            points[c, r, 1] = ahead * (-(col - lens[2]) / lens[0])
            points[c, r, 2] = ahead * (-(row - lens[3]) / lens[1])
    return points, wet
