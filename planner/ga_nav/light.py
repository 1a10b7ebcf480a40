"""Light, season and lens: under what an image was taken, drawn at random within what the outdoors has."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from scenes.shading import AMBIENT, SKY_COLOUR, SUN, SURFACE_COLOURS
from scenes.terrain import SURFACES, Surface

PLAIN_SHARE = 0.25
"""Of the images, under the camera's own plain light."""

GREEN = {Surface.GRASS}
_GROUND = np.array([SURFACE_COLOURS[surface] for surface in SURFACES], float)


@dataclass(frozen=True, eq=False)
class Season:
    """What becomes of green things: their colour goes by `share` over to `hue`, RGB 0 to 255, as light as it
    was; then all ground and leaves by `frost` over to white."""

    hue: tuple[float, float, float]
    share: float
    frost: float = 0.0

    def tinted(self, colours: np.ndarray) -> np.ndarray:
        """Colours (n, 3) of green things in this season."""
        hue = np.array(self.hue) / np.mean(self.hue)
        lightness = colours.mean(axis=1, keepdims=True)
        return self.frosted((1.0 - self.share) * colours + self.share * lightness * hue)

    def frosted(self, colours: np.ndarray) -> np.ndarray:
        return (1.0 - self.frost) * colours + self.frost * np.array((226.0, 232.0, 238.0))


def draw_season(rng: np.random.Generator) -> Season:
    """Spring, summer, autumn or winter, more or less."""
    spring, summer, autumn, winter = (128, 152, 62), (104, 128, 70), (176, 124, 52), (142, 130, 104)
    match rng.integers(4):
        case 0:
            return Season(spring, rng.uniform(0.2, 0.9))
        case 1:
            return Season(summer, rng.uniform(0.0, 0.5))
        case 2:
            return Season(autumn, rng.uniform(0.2, 0.9))
        case _:
            return Season(winter, rng.uniform(0.3, 0.9), rng.uniform(0.0, 0.2))


@dataclass(frozen=True, eq=False)
class Weather:
    """The light that a scene lies in; the default is the camera's own.

    sun : (3,) unit vector toward it, world frame; shadows : whether things cast them
    sunlight, skylight : (3,) what a face turned to the sun gets from it, and what every face gets
    horizon, zenith : (3,) RGB of the sky, 0 to 255
    haze : metres after which most of what is seen is the horizon's colour, inf for none
    ground : (surfaces, 3) RGB of the ground; mottle : how much its lightness wanders about, a share
    season : of what is green; variety : how much things of a kind differ, a share
    """

    sun: np.ndarray = field(default_factory=lambda: SUN)
    shadows: bool = False
    sunlight: np.ndarray = field(default_factory=lambda: np.full(3, 1.0 - AMBIENT))
    skylight: np.ndarray = field(default_factory=lambda: np.full(3, AMBIENT))
    horizon: np.ndarray = field(default_factory=lambda: np.array(SKY_COLOUR, float))
    zenith: np.ndarray = field(default_factory=lambda: np.array(SKY_COLOUR, float))
    haze: float = math.inf
    ground: np.ndarray = field(default_factory=lambda: _GROUND)
    mottle: float = 0.0
    season: Season = field(default_factory=lambda: Season((1.0, 1.0, 1.0), 0.0))
    variety: float = 0.0

    @property
    def level(self) -> np.ndarray:
        """(3,) the light that level ground in the open gets."""
        return self.skylight + self.sun[2] * self.sunlight


@dataclass(frozen=True)
class Lens:
    """What the camera makes of light.

    adapting : how far exposure and white balance make up for the strength and colour of the light by
        themselves, 0 to 1
    exposure : factor besides; warmth : share by which red is raised and blue lowered; gamma : exponent
    blur : standard deviation in pixels; grain, shot : of noise, of full white, and of a pixel's root
    """

    adapting: float = 0.0
    exposure: float = 1.0
    warmth: float = 0.0
    gamma: float = 1.0
    blur: float = 0.0
    grain: float = 0.0
    shot: float = 0.0


def draw_weather(rng: np.random.Generator) -> Weather:
    """A time of the day, a cover of clouds and a season."""
    azimuth, height = rng.uniform(0.0, 2.0 * math.pi), math.radians(rng.uniform(12.0, 75.0))
    sun = np.array(
        [math.cos(height) * math.cos(azimuth), math.cos(height) * math.sin(azimuth), math.sin(height)]
    )
    clouds = rng.uniform() if rng.random() < 0.5 else 0.0
    low = max(0.0, 1.0 - math.sin(height) / 0.6)  # a low sun is warm, and lights less
    warm = np.array([1.0, 1.0 - 0.22 * low, 1.0 - 0.5 * low])
    ambient = rng.uniform(0.3, 0.5) + 0.4 * clouds
    blue = np.array([176.0, 206.0, 235.0]) * (1.0 - 0.25 * rng.random())
    horizon = (1.0 - clouds) * blue * (1.0 - 0.3 * low * np.array([-0.3, 0.4, 1.0])) + clouds * 205.0
    zenith = (1.0 - clouds) * blue * np.array([0.75, 0.85, 1.0]) + clouds * rng.uniform(150.0, 215.0)
    season = draw_season(rng)
    ground = _GROUND * (
        1.0 + rng.normal(0.0, 0.03, (len(_GROUND), 1)) + rng.normal(0.0, 0.015, _GROUND.shape)
    )
    for code, surface in enumerate(SURFACES):
        if surface in GREEN:
            ground[code] = season.tinted(ground[code][None])[0]
        elif surface is not Surface.WATER:
            ground[code] = season.frosted(ground[code][None])[0]
    water = SURFACES.index(Surface.WATER)
    ground[water] = (1.0 - 0.35 * rng.random()) * ground[water] + rng.uniform(0.0, 0.3) * horizon
    return Weather(
        sun, bool(clouds < 0.5 and rng.random() < 0.6),
        (1.0 - ambient) * (1.0 - 0.7 * clouds) * warm * (1.0 + 0.4 * (1.0 - low)),
        ambient * (1.0 + 0.12 * (1.0 - clouds) * np.array([-0.6, 0.0, 1.0])),
        np.minimum(horizon, 255.0), np.minimum(zenith, 255.0),
        float(rng.uniform(40.0, 160.0)) if rng.random() < 0.5 else math.inf,
        np.clip(ground, 0.0, 255.0), float(rng.uniform(0.0, 0.08)), season, float(rng.uniform(0.0, 0.1)),
    )  # fmt: skip


def draw_lens(rng: np.random.Generator) -> Lens:
    return Lens(
        adapting=float(rng.uniform(0.7, 1.0)),
        exposure=float(np.exp(rng.normal(0.0, 0.12))),
        warmth=float(rng.normal(0.0, 0.03)),
        gamma=float(np.exp(rng.normal(0.0, 0.1))),
        blur=float(rng.uniform(0.0, 0.8)),
        grain=float(rng.uniform(0.0, 0.025)),
        shot=float(rng.uniform(0.0, 0.02)),
    )
