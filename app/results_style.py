"""How methods look wherever they stand side by side: one colour and one marker each."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

from app.view import palette

_COLOURS: dict[str, palette.RGB] = {
    "dwa": (158, 164, 174),
    "ga_nav": (244, 206, 66),
    "terp": (164, 122, 200),
    "least_cost": (110, 190, 255),
    "covernav_paper": (72, 196, 184),
    "covernav": (140, 206, 104),
    **palette.ROUTES,
}
_SPARE = (*palette.CURVES[4:], (120, 150, 240), (220, 170, 200), (170, 190, 120))
_MARKERS = "osD^vPXp*<>h"
_ON_PAPER = 0.72


def rgb_of(method: str) -> palette.RGB:
    """The same for a name wherever it comes up."""
    return _COLOURS.get(method) or _SPARE[zlib.crc32(method.encode()) % len(_SPARE)]


def colour_of(method: str, on_paper: bool) -> str:
    """As CSS; darker on white paper."""
    scale = _ON_PAPER if on_paper else 1.0
    red, green, blue = (round(scale * part) for part in rgb_of(method))
    return palette.css((red, green, blue))


def marker_of(method: str, methods: Sequence[str]) -> str:
    """matplotlib's code for a marker; each of a dozen methods has its own."""
    return _MARKERS[methods.index(method) % len(_MARKERS)]
