"""Compiled kernels are made at their first use, once after installing; better before a mission than in it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from planner.frames import Perception
from planner.mission import Mission
from scenes.catalogue import CoverKind
from scenes.scenario import (
    CoverObject,
    Family,
    GeneratedSource,
    MovingObstacle,
    Observer,
    ObstacleKind,
    Patrol,
    Point,
    Scenario,
    Start,
    Terrain,
)

CELLS = 41
TICKS = 6  # the camera looks once in five


@cache
def warm_up(method: str, perception: Perception = Perception.LIDAR, weights: Path | None = None) -> None:
    """Drive a method for a few ticks in a small scene, so that nothing is left to compile when it drives in
    earnest. Takes up to half a minute after installing and a second ever after; does nothing when called
    again.

    method, weights : as of `Mission`. Raises ValueError as `make_method` does."""
    mission = Mission(_small_scene(), method, 0, perception, weights=weights)
    try:
        for _ in range(TICKS):
            mission.tick()
    finally:
        mission.close()


def _small_scene() -> Scenario:
    """A bumpy field with a tree in the way, somebody walking, and somebody watching on his beat."""
    row, col = np.mgrid[:CELLS, :CELLS]
    return Scenario(
        version=1,
        name="warm-up",
        terrain=Terrain(
            resolution=0.5,
            heights=0.1 * np.sin(0.5 * row) * np.cos(0.4 * col),
            surface=("g" * CELLS,) * CELLS,
            source=GeneratedSource(family=Family.NORMAL, seed=0),
        ),
        start=Start(x=-4.0, y=0.0),
        goal=Point(x=5.0, y=0.0),
        cover=(CoverObject(id=1, kind=CoverKind.TREE, x=0.5, y=0.2),),
        observers=(Observer(id=1, x=2.0, y=7.0, patrol=Patrol(waypoints=(Point(x=-2.0, y=7.0),))),),
        obstacles=(
            MovingObstacle(
                id=1,
                kind=ObstacleKind.PERSON,
                x=-1.0,
                y=2.0,
                patrol=Patrol(waypoints=(Point(x=-1.0, y=-2.0),)),
            ),
        ),
    )
