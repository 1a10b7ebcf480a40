"""Flat scenes with walls to hide behind."""

import math

import numpy as np

from planner.covert_route import CovertPlanner
from scenes.scenario import CoverObject, Observer
from scenes.terrain import Heightmap


def flat(size: float = 24.0, resolution: float = 0.25) -> Heightmap:
    cells = round(size / resolution) + 1
    zeros = np.zeros((cells, cells), np.uint8)
    return Heightmap(np.zeros((cells, cells)), resolution, zeros, zeros)


def wall(number: int, x: float, y: float, length: float, yaw: float = 0.0) -> CoverObject:
    return CoverObject(id=number, kind="building", x=x, y=y, yaw=yaw, length=length, width=1.0, height=3.0)


def eye(number: int = 1, x: float = 0.0, y: float = 10.0, **fields) -> Observer:
    return Observer(id=number, x=x, y=y, **{"yaw": -90.0, "fov_horizontal": 360.0, "range": 60.0} | fields)


def behind_a_wall() -> CovertPlanner:
    """An observer in the north, and a long wall that hides the south: going round by it is the hidden way."""
    return CovertPlanner(flat(), [wall(1, 0.0, 0.0, 9.0)], [eye()])


START, GOAL = (-6.5, 1.5), (6.5, 1.5)


def plain_visible_share(planner: CovertPlanner, x: float, y: float, yaw: float) -> float:
    """Share of the hull's corners and sides that some observer sees, one by one."""
    from scenes.robot import HUSKY

    light = []
    for px, py, pz in HUSKY.hull_points():
        point = np.array(
            [
                x + math.cos(yaw) * px - math.sin(yaw) * py,
                y + math.sin(yaw) * px + math.cos(yaw) * py,
                float(planner.heightmap.height_at(x, y)) + pz,
            ]
        )
        best = 0.0
        for observer in planner.observers:
            ox, oy, _ = observer.pose_at(0.0)
            origin = np.array([ox, oy, float(planner.heightmap.height_at(ox, oy)) + observer.eye_height])
            if np.linalg.norm(point - origin) <= observer.range:
                best = max(best, float(planner.rays.visible(origin, point)[0]))
        light.append(best)
    return float(np.mean(light))
