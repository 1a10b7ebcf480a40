"""Shaping the ground."""

import math
from dataclasses import replace

import numpy as np
import pytest
from small import flat

from scenes.catalogue import Footprint
from scenes.relief import SHORE, Pond, Trail, fractal, level_pad
from scenes.terrain import Heightmap


def hilly(cells: int = 97, resolution: float = 0.25) -> Heightmap:
    heights = 3.0 * fractal(np.random.default_rng(5), cells, resolution, longest=20.0, shortest=5.0)
    return replace(flat(cells, resolution), heights=heights)


def test_fractal_hills_fill_zero_to_one_and_repeat():
    a, b = (fractal(np.random.default_rng(5), 64, 0.25, longest=12.0, shortest=3.0) for _ in range(2))
    assert (a == b).all() and a.min() == 0.0 and a.max() == 1.0


@pytest.mark.parametrize("shortest", [2.0, 5.0])
def test_waves_shorter_than_asked_for_are_absent(shortest):
    field = fractal(np.random.default_rng(5), 200, 0.25, longest=20.0, shortest=shortest)
    window = np.hanning(200)
    power = np.abs(np.fft.rfft2((field - field.mean()) * window * window[:, None])) ** 2
    frequency = np.hypot(np.fft.fftfreq(200, 0.25)[:, None], np.fft.rfftfreq(200, 0.25))
    assert power[frequency > 2.5 / shortest].sum() < 1e-4 * power.sum()


def test_there_are_no_spikes():
    heights = hilly().heights
    for axis in (0, 1):
        assert np.abs(np.diff(heights, n=2, axis=axis)).max() < 0.1


def test_a_pad_is_level_under_the_house_and_leaves_the_far_land_alone():
    ground = hilly()
    outline = Footprint(2.0, -1.0, 0.4, 6.0, 4.0, round=False)
    levelled = level_pad(ground, outline, apron=0.8, ramp=3.0)
    distance = outline.distance(np.column_stack([axis.ravel() for axis in ground.xy()])).reshape(ground.shape)
    assert np.ptp(levelled.heights[distance < 0.8]) < 1e-9
    assert (levelled.heights[distance > 3.8] == ground.heights[distance > 3.8]).all()


def test_a_trail_passes_its_waypoints():
    ground = hilly()
    trail = Trail.through(ground, np.array([(-14.0, -8.0), (-4.0, 2.0), (5.0, 0.0), (14.0, 6.0)]))
    assert trail.distance[ground.cell(-4.0, 2.0)] < 0.8 and trail.distance[ground.cell(5.0, 0.0)] < 0.8
    assert np.abs(trail.points).max() <= ground.bounds[1]


def test_a_graded_trail_is_gentler_than_the_land():
    ground = hilly()
    trail = Trail.through(ground, np.array([(-14.0, -8.0), (-4.0, 2.0), (5.0, 0.0), (14.0, 6.0)]))
    graded = trail.graded(ground, half_width=1.0, shoulder=2.5)
    on_way = trail.distance < 0.8
    assert graded.slope[on_way].mean() < 0.7 * ground.slope[on_way].mean()
    far = trail.distance > 3.6
    assert (graded.heights[far] == ground.heights[far]).all()


def test_water_is_level_with_its_shore_above():
    ground = hilly()
    pond = Pond.at(np.random.default_rng(2), ground, 3.0, 3.0, radius=3.0)
    filled = pond.filled(ground, bank=6.0)
    level = filled.heights[pond.water]
    assert np.ptp(level) == 0.0
    near = (pond.distance > 0.0) & (pond.distance < SHORE)
    assert (filled.heights[near] > level[0]).all()
    assert all(np.abs(np.diff(filled.heights, axis=axis)).max() < 0.2 for axis in (0, 1))
    assert math.pi * 2.0**2 < pond.water.sum() * 0.25**2 < math.pi * 4.0**2
