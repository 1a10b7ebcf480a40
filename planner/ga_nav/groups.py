"""The six groups and what belongs to each: a rock is bumpy ground here, though it is cover elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenes.catalogue import CATALOGUE, TraversabilityGroup
from scenes.rays import Body
from scenes.terrain import SURFACE_GROUP, SURFACES

GROUPS = tuple(TraversabilityGroup)
"""Background, smooth, rough, bumpy, forbidden, obstacle: their places are the labels, as GA-Nav has them."""

IGNORED = 255
"""The label of a pixel that counts nowhere."""

GROUP_CODE = {group: code for code, group in enumerate(GROUPS)}
_BACKGROUND, _OBSTACLE = GROUP_CODE[TraversabilityGroup.BACKGROUND], GROUP_CODE[TraversabilityGroup.OBSTACLE]

_SURFACE_CODE = np.array([GROUP_CODE[SURFACE_GROUP[surface]] for surface in SURFACES], np.uint8)
_CLASS_CODE = {entry.class_id: GROUP_CODE[entry.group] for entry in CATALOGUE.values()}


def surface_groups(surface: np.ndarray) -> np.ndarray:
    """Labels, uint8, of ground by its code in `scenes.terrain.SURFACES`."""
    return _SURFACE_CODE[surface]


def pixel_groups(body: np.ndarray, surface: np.ndarray, bodies: Sequence[Body]) -> np.ndarray:
    """Labels, uint8, of pixels by what they show.

    body : int, index into `bodies`, -1 for nothing; surface : int, code of the ground there where it is one
    Cover has its class's group; persons, vehicles and observers are obstacles; nothing is background.
    """
    table = np.array([*(_CLASS_CODE.get(each.class_id, _OBSTACLE) for each in bodies), _BACKGROUND], np.uint8)
    labels = table[body]
    ground = body == 0
    labels[ground] = _SURFACE_CODE[surface[ground]]
    return labels
