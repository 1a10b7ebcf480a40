"""Colours as they shall appear. viser's renderer maps colours like film (ACES) even where nothing is lit,
which pales them; sent through the inverse, they come out on the screen as in the legend.

Source: three.js `ACESFilmicToneMapping`, a fit by S. Hill of the Academy's reference transform.
"""

from __future__ import annotations

import numpy as np

_IN = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)  # fmt: skip
_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)  # fmt: skip
_EXPOSURE = 1.0 / 0.6
_BRIGHTEST = 0.97  # of the film's curve; beyond it the inverse runs off


def for_screen(colours: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 sRGB to send so that these (n, 3) appear, as far as the film's range goes."""
    film = np.clip(linear(colours) @ np.linalg.inv(_OUT).T, 0.0, _BRIGHTEST)
    a = 1.0 - 0.983729 * film
    b = 0.0245786 - 0.4329510 * film
    c = -0.000090537 - 0.238081 * film
    scene = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    return _srgb(scene @ np.linalg.inv(_IN).T / _EXPOSURE)


def linear(colours: np.ndarray) -> np.ndarray:
    """Linear light, 0 to 1, of uint8 sRGB."""
    share = np.asarray(colours, float) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _srgb(light: np.ndarray) -> np.ndarray:
    light = np.clip(light, 0.0, 1.0)
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    return np.round(255.0 * share).astype(np.uint8)
