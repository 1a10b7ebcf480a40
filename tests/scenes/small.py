"""Small documents for the tests of this folder."""

from __future__ import annotations

from typing import Any

import numpy as np

from scenes.scenario import Scenario
from scenes.terrain import SURFACE_CODE, Heightmap, Surface


def flat(cells: int = 41, resolution: float = 0.5, height: float = 0.0) -> Heightmap:
    """Level grass, 20 m square by default."""
    grass, measured = np.zeros((2, cells, cells), np.uint8)
    return Heightmap(np.full((cells, cells), height), resolution, grass, measured)


def document(cells: int = 41, **changes: Any) -> dict[str, Any]:
    """A valid scenario as the plain values of its JSON: level grass, 20 m square by default."""
    return {
        "version": 1,
        "name": "test field",
        "terrain": {
            "resolution": 0.5,
            "heights": [[0.0] * cells for _ in range(cells)],
            "surface": ["g" * cells] * cells,
            "source": {"kind": "generated", "family": "normal", "seed": 1},
        },
        "start": {"x": -6.0, "y": 0.0, "yaw": 0.0},
        "goal": {"x": 6.0, "y": 0.0},
    } | changes


def scenario(**changes: Any) -> Scenario:
    return Scenario.model_validate(document(**changes))


def with_water(ground: Heightmap, rows: slice, cols: slice) -> Heightmap:
    surface = ground.surface.copy()
    surface[rows, cols] = SURFACE_CODE[Surface.WATER]
    return Heightmap(ground.heights, ground.resolution, surface, ground.quality)
