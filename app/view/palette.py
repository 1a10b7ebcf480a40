"""The colours of the studio: one meaning, one colour, in the scene, the panel and the page alike.

Seen is orange, hidden blue-green, unknown grey. Cost is a scale of one hue that darkens, so it reads
without colour vision and never collides with the two. Colours are sRGB, 0 to 255.
"""

from __future__ import annotations

import numpy as np

from planner.frames import Rejection
from scenes.catalogue import TraversabilityGroup
from scenes.terrain import Surface

RGB = tuple[int, int, int]

GROUND: dict[Surface, RGB] = {
    Surface.GRASS: (112, 132, 84),
    Surface.TRAIL: (172, 152, 118),
    Surface.GRAVEL: (146, 141, 131),
    Surface.MUD: (104, 86, 66),
    Surface.SAND: (194, 176, 134),
    Surface.ROCK: (124, 120, 113),
    Surface.ASPHALT: (88, 89, 92),
    Surface.WATER: (74, 92, 92),
}
WATER: RGB = (72, 128, 150)
NO_DATA: RGB = (112, 114, 118)
EARTH: RGB = (66, 56, 47)
PANEL: RGB = (26, 27, 30)
BACKDROP_TOP: RGB = (30, 37, 46)
BACKDROP_BOTTOM: RGB = (66, 75, 84)

SEEN: RGB = (240, 145, 40)
HIDDEN: RGB = (38, 160, 150)
UNKNOWN: RGB = (150, 152, 156)
UNKNOWN_STRIPE: RGB = (116, 118, 124)

GOAL: RGB = (244, 206, 66)
START: RGB = (196, 206, 214)
SELECTED: RGB = (255, 255, 255)
CHOSEN_COVER: RGB = HIDDEN
DETECTION: RGB = (214, 226, 240)

CHOSEN_ARC: RGB = (255, 246, 150)
CANDIDATE_ARC: RGB = (190, 198, 190)
WAYPOINT: RGB = (120, 200, 255)
ROUTE: RGB = (120, 200, 255)
ROUTES: dict[str, RGB] = {
    "route_shortest": (250, 250, 246),
    "route_balanced": (110, 190, 255),
    "route": (236, 106, 196),
}
"""By the methods that follow them: the shortest, a balanced and the most hidden one."""
REFUGE: RGB = (190, 255, 214)
POST: RGB = (255, 232, 120)
BLOCKED: RGB = (202, 64, 84)
GHOST: RGB = (176, 214, 255)
TRIALS: tuple[RGB, RGB] = ((224, 222, 214), (110, 190, 255))
"""Drives before and after learning."""
TRAVELLED: RGB = (236, 240, 244)
SCAN_LOW: RGB = (92, 150, 214)
SCAN_HIGH: RGB = (226, 242, 255)

REJECTED: dict[Rejection, RGB] = {
    Rejection.COLLISION: (202, 64, 84),
    Rejection.CANNOT_STOP: (222, 140, 158),
    Rejection.MOVING_OBSTACLE: (178, 108, 206),
    Rejection.SLOPE: (134, 94, 60),
    Rejection.TILT: (196, 158, 92),
    Rejection.UNKNOWN_GROUND: (132, 136, 142),
    Rejection.OFF_THE_MAP: (62, 66, 74),
}
REJECTION_WORDS: dict[Rejection, str] = {
    Rejection.COLLISION: "would collide",
    Rejection.CANNOT_STOP: "could not stop in time",
    Rejection.MOVING_OBSTACLE: "crosses a moving obstacle",
    Rejection.SLOPE: "too steep",
    Rejection.TILT: "would tilt too far",
    Rejection.UNKNOWN_GROUND: "unknown ground",
    Rejection.OFF_THE_MAP: "leaves the map",
}

_COST_STOPS = np.array(
    [(238, 226, 246), (206, 178, 226), (164, 122, 200), (118, 66, 168), (72, 22, 124)], float
)
COST_FORBIDDEN: RGB = (34, 8, 58)
COST_FULL = 100.0


def cost_colours(cost: np.ndarray) -> np.ndarray:
    """(..., 4) uint8 RGBA of costs in 0 to 100: pale and nearly clear where cheap, deep violet where dear,
    darkest where forbidden (inf), clear where unknown (NaN)."""
    share = np.clip(np.nan_to_num(cost, nan=0.0, posinf=COST_FULL) / COST_FULL, 0.0, 1.0)
    position = share * (len(_COST_STOPS) - 1)
    low = np.minimum(position.astype(int), len(_COST_STOPS) - 2)
    part = (position - low)[..., None]
    rgba = np.empty((*cost.shape, 4), np.uint8)
    rgba[..., :3] = np.round((1.0 - part) * _COST_STOPS[low] + part * _COST_STOPS[low + 1])
    rgba[..., 3] = np.round(40 + 165 * np.sqrt(share))
    forbidden = np.isposinf(cost)
    rgba[forbidden] = (*COST_FORBIDDEN, 205)
    rgba[np.isnan(cost), 3] = 0
    return rgba


GROUPS: dict[TraversabilityGroup, RGB] = {
    TraversabilityGroup.BACKGROUND: (122, 138, 160),
    TraversabilityGroup.SMOOTH: (244, 240, 226),
    TraversabilityGroup.ROUGH: (158, 190, 96),
    TraversabilityGroup.BUMPY: (150, 98, 56),
    TraversabilityGroup.FORBIDDEN: (56, 96, 214),
    TraversabilityGroup.OBSTACLE: (150, 30, 96),
}
"""Ground by how one drives on it, apart in lightness as much as in hue."""

_EXPOSURE_STOPS = np.array([HIDDEN, (232, 224, 196), SEEN], float)
_COUNT_STOPS = np.array(
    [HIDDEN, (250, 202, 126), SEEN, (216, 98, 22), (168, 58, 14), (116, 28, 22)], np.uint8
)


def exposure_colours(exposure: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of exposures from 0, hidden, to 1, in plain view; pale where half the light comes
    through."""
    return _along(_EXPOSURE_STOPS, exposure)


def count_colours(most: int) -> np.ndarray:
    """(most + 1, 3) uint8 by the number of observers: hidden, then ever deeper orange."""
    return _COUNT_STOPS[np.minimum(np.arange(most + 1), len(_COUNT_STOPS) - 1)]


_ELEVATION_STOPS = np.array([(38, 44, 58), (92, 84, 72), (168, 150, 116), (240, 230, 204)], float)
_ATTENTION_STOPS = np.array([(14, 20, 40), (28, 74, 146), (70, 156, 226), (220, 244, 255)], float)
_COVER_STOPS = np.array([(70, 72, 66), (110, 178, 84)], float)
CURVES: tuple[RGB, ...] = (
    (244, 244, 240), (110, 190, 255), (240, 145, 40), (38, 160, 150), (236, 106, 196), (244, 206, 66),
    (164, 122, 200), (202, 64, 84), (150, 206, 120), (176, 150, 120), (140, 148, 160),
)  # fmt: skip
"""Curves side by side, as different in lightness as in hue; the first is the sum of the others."""


def elevation_colours(share: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of heights from 0, the lowest shown, to 1, the highest: darker is lower."""
    return _along(_ELEVATION_STOPS, share)


def attention_colours(share: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of attention from 0, none, to 1, the most: lighter is more."""
    return _along(_ATTENTION_STOPS, share)


def cover_colours(share: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of the presence of cover, 0 to 1."""
    return _along(_COVER_STOPS, share)


def _along(stops: np.ndarray, share: np.ndarray) -> np.ndarray:
    at = np.linspace(0.0, 1.0, len(stops))
    parts = [np.interp(share, at, stops[:, part]) for part in range(3)]
    return np.round(np.column_stack(parts)).astype(np.uint8)


def css(colour: RGB) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
