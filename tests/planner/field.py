"""A meadow to drive on."""

import numpy as np

from scenes.scenario import CoverObject, GeneratedSource, Point, Scenario, Start, Terrain


def field(goal=(5.0, 0.0), cover=(), obstacles=(), observers=(), heights=None, start=(0.0, 0.0)) -> Scenario:
    """A meadow of 24 m, flat unless told; the robot starts in its middle and looks east."""
    cells = 97
    terrain = Terrain(
        resolution=0.25,
        heights=np.zeros((cells, cells)) if heights is None else heights,
        surface=("g" * cells,) * cells,
        source=GeneratedSource(family="normal", seed=0),
    )
    return Scenario(
        version=1, name="field", terrain=terrain,
        start=Start(x=start[0], y=start[1]), goal=Point(x=goal[0], y=goal[1]),
        cover=cover, obstacles=obstacles, observers=observers,
    )  # fmt: skip


def thing(identifier=1, kind="rock", **fields) -> CoverObject:
    return CoverObject.model_validate({"id": identifier, "kind": kind} | fields)


def ticks(mission, count: int):
    return [mission.tick() for _ in range(count)]
