"""Compiled kernels are made at their first use, once after installing; better before a mission than in it."""

from __future__ import annotations

from functools import cache

import numpy as np

from planner.frames import Perception
from planner.methods import DEFAULT_METHOD, METHODS
from planner.mission import Mission
from planner.motion import MOTIONS
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
def warm_up() -> None:
    """Drive a few ticks of every method and motion control in a small scene, so that nothing is left to
    compile. Takes most of a minute after installing and a second or so ever after; does nothing when called
    again."""
    scenario = _small_scene()
    for method in (*METHODS, *(f"{DEFAULT_METHOD}+{motion}" for motion in MOTIONS[1:])):
        for perception in Perception:
            mission = Mission(scenario, method, 0, perception)
            try:
                for _ in range(TICKS if perception is Perception.LIDAR else 1):
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
