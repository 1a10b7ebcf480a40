"""A small plain scene for tests that are about the rooms above it."""

import numpy as np

from scenes.scenario import (
    CoverObject,
    GeneratedSource,
    Observer,
    Point,
    Scenario,
    Start,
    Terrain,
)


def meadow_scene() -> Scenario:
    """20 × 20 m of flat grass at 0.5 m, a tree and an observer to the north, 6 m to drive."""
    return Scenario(
        version=1,
        name="Test meadow",
        terrain=Terrain(
            resolution=0.5,
            heights=np.zeros((41, 41)),
            surface=("g" * 41,) * 41,
            source=GeneratedSource(family="normal", seed=0),
        ),
        start=Start(x=-3.0, y=0.0),
        goal=Point(x=3.0, y=0.0),
        cover=(CoverObject(id=1, kind="tree", x=0.0, y=5.0),),
        observers=(Observer(id=1, x=0.0, y=8.0, yaw=-90.0),),
    )
