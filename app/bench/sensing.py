"""The bench of the senses: lidar, map and camera against Bullet's own rays and renderer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from app.bench.measure import Result, faster, interleaved
from app.bench.peers import numpy_patch
from planner.elevation_map import ElevationMap, MapConfig
from planner.perception import lidar_scan
from scenes.families import generate
from scenes.physics import World
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import Family, Scenario
from scenes.sensors import CameraConfig, Lidar, LidarConfig, SemanticCamera

COVER_COUNT = 60
REPEATS = 9
SILENT_LIDAR = LidarConfig(noise=0.0)


@dataclass(frozen=True)
class _Stage:
    """One scene in both engines, and where the robot stands in it."""

    scenario: Scenario
    rays: RayScene
    world: World
    pose: Pose


@cache
def _stage() -> _Stage:
    """A generated forest with its first 60 objects."""
    scenario = generate(Family.FOREST, 3)
    scenario = scenario.revised(cover=scenario.cover[:COVER_COUNT])
    heightmap = scenario.terrain.heightmap()
    world = World(heightmap, scenario.cover, (), scenario.start, cover_meshes=True)
    return _Stage(scenario, RayScene(heightmap, scenario.cover), world, world.pose)


def lidar_turn() -> Result:
    """One turn of the VLP-16 over terrain and 60 objects."""
    stage, lidar = _stage(), Lidar(SILENT_LIDAR)
    origin, directions = _beams(stage.pose, lidar)
    reach = SILENT_LIDAR.max_range
    ours_ms, peer_ms = interleaved(
        lambda: lidar.scan(stage.rays, stage.pose, np.random.default_rng(0)),
        lambda: stage.world.eyes.cast_rays(origin, directions, reach),
        REPEATS,
        ours_per_turn=5,
    )
    ours = stage.rays.cast(origin, directions, reach)
    theirs, labels = stage.world.eyes.cast_rays(origin, directions, reach)
    both = np.isfinite(ours.distance) & np.isfinite(theirs)
    same = np.abs(ours.distance[both] - theirs[both]) <= 0.02
    missed = np.isfinite(ours.distance) == np.isfinite(theirs)
    return faster(
        "lidar_turn",
        ours_ms,
        peer_ms,
        "pybullet rayTestBatch, one thread, without building a cloud",
        f"{len(stage.scenario.cover)} objects; of {len(directions)} rays {_percent(missed)} agree on hit or "
        f"miss; of the common hits {_percent(same)} agree within 2 cm and "
        f"{_percent((ours.body == labels)[both])} on the thing hit",
    )


def scan_to_patch() -> Result:
    """From rays over a point cloud and the rolling map to the 40 × 40 patch."""
    stage, lidar, config = _stage(), Lidar(SILENT_LIDAR), MapConfig()
    elevation_map = ElevationMap(stage.pose.x, stage.pose.y, config)
    sensor = stage.pose.compose(SILENT_LIDAR.mount)
    still = np.ones(len(stage.rays.bodies) + 1, bool)
    origin, directions = _beams(stage.pose, lidar)

    def ours() -> tuple[np.ndarray, np.ndarray]:
        cloud = lidar.scan(stage.rays, stage.pose, np.random.default_rng(0))
        world = stage.pose.to_world(cloud.points_body.astype(float))
        elevation_map.add_scan(lidar_scan(cloud, world, still, sensor, SILENT_LIDAR), stage.pose)
        return elevation_map.patch(stage.pose)

    def peer() -> tuple[np.ndarray, np.ndarray]:
        distance, _ = stage.world.eyes.cast_rays(origin, directions, SILENT_LIDAR.max_range)
        heard = np.isfinite(distance) & (distance >= SILENT_LIDAR.min_range)
        points = origin + distance[heard, None].astype(float) * directions[heard]
        return numpy_patch(points, stage.pose, config)

    ours_ms, peer_ms = interleaved(ours, peer, REPEATS, ours_per_turn=3)
    (heights, unknown), (peer_heights, peer_unknown) = ours(), peer()
    both = ~unknown & ~peer_unknown
    same = np.abs(heights - peer_heights)[both] <= 0.1
    return faster(
        "scan_to_patch",
        ours_ms,
        peer_ms,
        "rayTestBatch and plain NumPy gridding, without telling ground from things or clearing",
        f"{int(both.sum())} of 1,600 patch cells known to both; {_percent(same)} of them within 10 cm "
        f"(median {1e3 * float(np.median(np.abs(heights - peer_heights)[both])):.0f} mm)",
    )


def semantic_image() -> Result:
    """One 320 × 240 image of depth, instance, class and colour."""
    stage, config = _stage(), CameraConfig()
    camera = SemanticCamera(config)
    place = stage.pose.compose(config.mount)
    peer_args = (place, config.width, config.height, config.fov_horizontal, config.max_range)
    ours_ms, peer_ms = interleaved(
        lambda: camera.capture(stage.rays, stage.pose, np.random.default_rng(0)),
        lambda: stage.world.eyes.render_segmentation(*peer_args),
        REPEATS,
        ours_per_turn=3,
    )
    image = camera.capture(stage.rays, stage.pose, np.random.default_rng(0))
    depth, labels = stage.world.eyes.render_segmentation(*peer_args)
    both = (image.body >= 0) & (labels >= 0)
    near = np.abs(image.depth[both] - depth[both]) <= 0.05 + 0.02 * depth[both]
    return faster(
        "semantic_image",
        ours_ms,
        peer_ms,
        f"pybullet TinyRenderer, {config.width} × {config.height} segmentation and depth",
        f"{_percent(image.body == labels)} of the pixels carry the same instance label; where both see "
        f"something {_percent(near)} of the depths agree within 5 cm and a fiftieth",
    )


def _beams(pose: Pose, lidar: Lidar) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and unit directions (n, 3) of a turn, in the world."""
    return pose.to_world(lidar.config.mount.position), lidar.directions @ pose.rotation.T


def _percent(agree: np.ndarray) -> str:
    return f"{100.0 * float(np.mean(agree)):.2f} %"
