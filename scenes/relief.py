"""Shaping the ground: fractal relief, levelled building pads, graded trails, ponds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from scipy.interpolate import CubicSpline

from scenes.catalogue import Footprint
from scenes.terrain import Heightmap


def fractal(
    rng: np.random.Generator,
    cells: int,
    resolution: float,
    longest: float,
    shortest: float,
    falloff: float = 2.0,
) -> np.ndarray:
    """A smooth random field (cells, cells) between 0 and 1 whose waves measure `shortest` to `longest`
    metres; their amplitude falls with the power `falloff` of frequency (spectral synthesis)."""
    padded = int(1.3 * cells)
    noise = np.fft.rfft2(rng.normal(size=(padded, padded)))
    frequency = np.hypot(np.fft.fftfreq(padded, resolution)[:, None], np.fft.rfftfreq(padded, resolution))
    frequency[0, 0] = np.inf
    gain = np.maximum(frequency, 1.0 / longest) ** -falloff
    gain *= np.exp(-((frequency * shortest) ** 2)) * (1.0 - np.exp(-((frequency * 1.5 * longest) ** 2)))
    field = np.fft.irfft2(noise * gain, s=(padded, padded))[:cells, :cells]
    return (field - field.min()) / np.ptp(field)


def level_pad(ground: Heightmap, outline: Footprint, apron: float, ramp: float) -> Heightmap:
    """Flat ground under `outline` and `apron` metres about it, easing into the land over `ramp` metres."""
    distance = distance_to(ground, outline)
    level = ground.heights[distance < 0.5].mean()
    return _blended(ground, level, _ease((distance - apron) / ramp))


def distance_to(ground: Heightmap, outline: Footprint) -> np.ndarray:
    """(rows, cols) signed metres from each sample to an outline."""
    x, y = ground.xy()
    return outline.distance(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)


SHORE = 1.5


@dataclass(frozen=True, eq=False)
class Trail:
    """A winding way.

    points : (n, 2) its centreline, samples half a cell apart, inside the map
    distance : (rows, cols) metres to the centreline
    nearest : (2, rows, cols) row and column of the nearest cell on the centreline
    """

    points: np.ndarray
    distance: np.ndarray
    nearest: np.ndarray

    @classmethod
    def through(cls, ground: Heightmap, waypoints: np.ndarray) -> Trail:
        """A smooth curve by the waypoints (k, 2)."""
        legs = np.hypot(*np.diff(waypoints, axis=0).T)
        knots = np.concatenate([[0.0], np.cumsum(np.sqrt(legs))])
        samples = max(2, int(2.4 * legs.sum() / ground.resolution))
        points = CubicSpline(knots, waypoints)(np.linspace(0.0, knots[-1], samples))
        points = ndimage.gaussian_filter1d(points, 1.0 / (0.45 * ground.resolution), axis=0, mode="nearest")
        points = points[np.abs(points).max(axis=1) <= ground.bounds[1]]
        off = np.ones(ground.shape, bool)
        off[ground.cells(*points.T)] = False
        distance, nearest = ndimage.distance_transform_edt(
            off, sampling=ground.resolution, return_indices=True
        )  # type: ignore[misc]
        return cls(points, distance, nearest)

    def graded(self, ground: Heightmap, half_width: float, shoulder: float) -> Heightmap:
        """Level across and gentle along the way, easing into the land over `shoulder` metres."""
        rows, cols = ground.cells(*self.points.T)
        sigma = 4.0 / (0.45 * ground.resolution)
        line = np.zeros(ground.shape)
        line[rows, cols] = ndimage.gaussian_filter1d(ground.heights[rows, cols], sigma, mode="nearest")
        target = ndimage.gaussian_filter(line[self.nearest[0], self.nearest[1]], 0.4 / ground.resolution)
        return _blended(ground, target, _ease((self.distance - half_width) / shoulder))


@dataclass(frozen=True, eq=False)
class Pond:
    """water : (rows, cols) bool; distance : (rows, cols) metres to the water, 0 in it."""

    water: np.ndarray
    distance: np.ndarray

    @classmethod
    def none(cls, ground: Heightmap) -> Pond:
        return cls(np.zeros(ground.shape, bool), np.full(ground.shape, np.inf))

    def joined(self, other: Pond) -> Pond:
        return Pond(self.water | other.water, np.minimum(self.distance, other.distance))

    @classmethod
    def at(cls, rng: np.random.Generator, ground: Heightmap, x: float, y: float, radius: float) -> Pond:
        """A pond with an uneven shore about (x, y)."""
        grid_x, grid_y = ground.xy()
        bearing = np.arctan2(grid_y - y, grid_x - x)
        phase = rng.uniform(0.0, 2.0 * np.pi, 3)
        shore = 1.0 + sum(
            share * np.cos(order * bearing + phase[index])
            for index, (order, share) in enumerate(((2, 0.18), (3, 0.1), (5, 0.05)))
        )
        water = np.hypot(grid_x - x, grid_y - y) < radius * shore
        distance = ndimage.distance_transform_edt(~water, sampling=ground.resolution)
        return cls(water, np.asarray(distance))

    def filled(self, ground: Heightmap, bank: float) -> Heightmap:
        """A flat water level, dug below its shore, with banks that ease into the land over `bank` metres."""
        level = float(ground.heights[self.distance < SHORE].min()) - 0.05
        banked = _blended(ground, level + 0.04, _ease(self.distance / bank))
        return replace(ground, heights=np.where(self.water, level, banked.heights))


def _ease(distance: np.ndarray) -> np.ndarray:
    """1 up to distance 0, falling smoothly to 0 at distance 1."""
    t = 1.0 - np.clip(distance, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _blended(ground: Heightmap, target: np.ndarray | float, weight: np.ndarray) -> Heightmap:
    return replace(ground, heights=ground.heights + weight * (target - ground.heights))
