"""A bare VLP-16 over a ray scene, and grounds to drive it over, for the tests of the map."""

import math

import numpy as np

from planner.ground_segmentation import Scan
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import CoverObject
from scenes.terrain import Heightmap

COLUMNS = 900
ELEVATIONS = np.radians(np.arange(-15.0, 16.0, 2.0))
_AZIMUTHS = (2.0 * np.pi * np.arange(COLUMNS) / COLUMNS)[:, None]
DIRECTIONS = np.stack(
    [
        np.cos(ELEVATIONS) * np.cos(_AZIMUTHS),
        np.cos(ELEVATIONS) * np.sin(_AZIMUTHS),
        np.broadcast_to(np.sin(ELEVATIONS), (COLUMNS, 16)),
    ],
    axis=-1,
).reshape(-1, 3)


def ground(height=lambda x, y: 0.0 * x, size=48.0, resolution=0.25) -> Heightmap:
    """A heightmap of grass whose heights are a function of x and y."""
    cells = int(size / resolution) + 1
    zeros = np.zeros((cells, cells), np.uint8)
    x, y = Heightmap(np.zeros((cells, cells)), resolution, zeros, zeros).xy()
    return Heightmap(height(x, y), resolution, zeros, zeros)


def thing(kind: str, x: float, y: float, **fields) -> CoverObject:
    return CoverObject(id=fields.pop("id", 1), kind=kind, x=float(x), y=float(y), **fields)


def standing(heightmap: Heightmap, x: float, y: float, yaw: float = 0.0) -> Pose:
    """`pose_world_base` on the ground, tilted like the ground about it."""
    cos, sin, reach = math.cos(yaw), math.sin(yaw), 0.3
    ahead, behind, left, right = (
        float(heightmap.height_at(x + cos * a - sin * b, y + sin * a + cos * b))
        for a, b in ((reach, 0), (-reach, 0), (0, reach), (0, -reach))
    )
    pitch = -math.atan((ahead - behind) / (2 * reach))
    roll = math.atan((left - right) / (2 * reach) * math.cos(pitch))
    return Pose(x, y, 0.25 * (ahead + behind + left + right), roll, pitch, yaw)


def turn(rays: RayScene, pose: Pose, sigma: float = 0.0, seed: int = 0) -> tuple[Scan, np.ndarray]:
    """One turn from a robot at `pose`, and the body that each return (columns, beams) comes from."""
    sensor = pose.compose(HUSKY.lidar_mount)
    directions = DIRECTIONS @ sensor.rotation.T
    hits = rays.cast(sensor.position, directions, 100.0)
    ranges = hits.distance + sigma * np.random.default_rng(seed).standard_normal(len(directions))
    ranges[~np.isfinite(ranges) | (ranges < 0.9)] = np.nan
    points = (sensor.position + directions * ranges[:, None]).reshape(COLUMNS, 16, 3)
    return Scan(points, sensor, ELEVATIONS, max(sigma, 0.01)), hits.body.reshape(COLUMNS, 16)
