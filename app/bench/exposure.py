"""The bench of exposure: what four observers see of a whole scene, against Bullet's ray test."""

from __future__ import annotations

import numpy as np

from app.bench.measure import Result, faster, interleaved
from planner.exposure import ExposureField, exposure_field, views_at
from scenes.families import generate
from scenes.physics import World
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import Family, Observer

OBJECTS = 200
PLACES = ((-20.0, -20.0, 45.0), (20.0, -15.0, 140.0), (0.0, 5.0, -90.0), (-12.0, 22.0, -60.0))
"""x, y and facing in degrees; field of view and range are an observer's usual ones."""

REPEATS = 3
TOUCHING = 0.03  # metres before its end in which what a line meets does not count


def united_exposure() -> Result:
    """United exposure of four observers over a forest of 256² cells with 200 objects."""
    scenario = generate(Family.FOREST, 3, size_m=63.75)
    scenario = scenario.revised(cover=scenario.cover[:OBJECTS])
    heightmap = scenario.terrain.heightmap()
    team = [Observer(id=number, x=x, y=y, yaw=yaw) for number, (x, y, yaw) in enumerate(PLACES, 1)]
    views = views_at(team, heightmap, 0.0)
    rays = RayScene(heightmap, scenario.cover)
    x, y = heightmap.xy()
    cells = np.column_stack([x.ravel(), y.ravel(), heightmap.heights.ravel() + HUSKY.height])

    def ours() -> tuple[ExposureField, np.ndarray]:
        field = exposure_field(rays, heightmap, views)
        return field, field.united

    with World(heightmap, scenario.cover, (), scenario.start, cover_meshes=True) as world:

        def peer() -> np.ndarray:
            """(4, cells) bool: held by the view, and nothing at all between."""
            clear = np.zeros((len(views), len(cells)), bool)
            for layer, view in zip(clear, views, strict=True):
                held = np.flatnonzero(view.holds(cells))
                offset = cells[held] - view.eye
                length = np.linalg.norm(offset, axis=1)
                met, _ = world.eyes.cast_rays(view.eye, offset / length[:, None], view.range)
                layer[held] = met >= length - TOUCHING
            return clear

        ours_ms, peer_ms = interleaved(ours, peer, REPEATS, ours_per_turn=5)
        theirs = peer()
    field, _ = ours()
    held = np.array([view.holds(cells) for view in views])
    same = np.mean(((field.seen.reshape(len(views), -1) == 1.0) == theirs)[held])
    return faster(
        "united_exposure",
        ours_ms,
        peer_ms,
        "pybullet rayTestBatch, one thread, first hits only: it knows no light through trees and bushes",
        f"{heightmap.shape[0]} × {heightmap.shape[1]} cells, {len(scenario.cover)} objects, "
        f"{int(held.sum())} lines of sight; whether anything is between agrees on {100.0 * same:.2f} %",
    )
