"""Viewsheds: the definition of a visible cell, to the last cell."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner.exposure import viewshed
from planner.viewshed import viewsheds

TOLERANCE = 1e-9


def stands_above(line_heights, places, sight_line):
    """Whether ground at places (n,) on lines of samples (n, samples) is above a sight line's heights (n,)."""
    for heights, place, sight in zip(line_heights, places, sight_line, strict=True):
        before, after = math.floor(place), math.ceil(place)
        share = place - before
        ground = (1.0 - share) * heights[before] + share * heights[after]
        if ground > sight + TOLERANCE:
            return True
    return False


def sees(heights, row, column, eye, i, j, top):
    """Whether an eye at height `eye` over a cell sees the height `top` over cell (i, j)."""
    rows, columns = abs(i - row), abs(j - column)
    k = np.arange(1, rows)
    lines = heights[row + np.sign(i - row) * k]
    if stands_above(lines, column + (j - column) * k / max(rows, 1), eye + (top - eye) * k / max(rows, 1)):
        return False
    k = np.arange(1, columns)
    lines = heights.T[column + np.sign(j - column) * k]
    places = row + (i - row) * k / max(columns, 1)
    return not stands_above(lines, places, eye + (top - eye) * k / max(columns, 1))


def plain_viewshed(heights, row, column, eye_height, target_height=0.0):
    """The definition, cell by cell and crossing by crossing."""
    eye = heights[row, column] + eye_height
    seen = np.empty(heights.shape, bool)
    for i, j in np.ndindex(*heights.shape):
        seen[i, j] = sees(heights, row, column, eye, i, j, heights[i, j] + target_height)
    return seen


def fractal(rng, rows, cols):
    noise = np.fft.fft2(rng.normal(size=(32, 32)))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(32), np.fft.fftfreq(32)))
    frequency[0, 0] = 1.0
    ground = np.fft.ifft2(noise / frequency**1.9).real
    return (5.0 * ground / ground.std())[:rows, :cols]


GROUNDS = {
    "flat": lambda rng, rows, cols: np.zeros((rows, cols)),
    "fractal": fractal,
    "stepped": lambda rng, rows, cols: np.round(fractal(rng, rows, cols)),
    "cliff": lambda rng, rows, cols: np.tile(25.0 * (np.arange(cols) > rng.integers(cols)), (rows, 1)),
    "posts": lambda rng, rows, cols: np.where(rng.random((rows, cols)) < 0.06, 10.0, 0.0),
    "noise": lambda rng, rows, cols: rng.normal(size=(rows, cols)),
    "slope": lambda rng, rows, cols: np.add.outer(0.5 * np.arange(rows), 0.25 * np.arange(cols)) + 400.0,
    "pit": lambda rng, rows, cols: 0.3 * np.hypot(*np.mgrid[:rows, :cols]),
}


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("seed", range(30))
def test_every_cell_is_as_the_definition_says(ground, seed):
    rng = np.random.default_rng(seed)
    heights = GROUNDS[ground](rng, *rng.integers(2, 27, 2))
    row, column = rng.integers(heights.shape[0]), rng.integers(heights.shape[1])
    eye_height, target_height = rng.choice([0.0, 0.5, 1.7, 10.0]), rng.choice([0.0, 0.4, 2.0])
    ours = viewshed(heights, row, column, eye_height, target_height)
    plain = plain_viewshed(heights, row, column, eye_height, target_height)
    assert np.array_equal(ours, plain), np.argwhere(ours != plain)


@pytest.mark.parametrize("shape, row, column", [((70, 9), 69, 0), ((6, 80), 3, 40), ((48, 48), 0, 47)])
def test_long_sight_lines_are_as_the_definition_says(shape, row, column):
    rng = np.random.default_rng(5)
    heights = 0.2 * rng.normal(size=shape).cumsum(axis=0)
    assert np.array_equal(viewshed(heights, row, column, 3.0), plain_viewshed(heights, row, column, 3.0))


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_any_grid_is_as_the_definition_says(data):
    rows, cols = data.draw(st.integers(1, 14)), data.draw(st.integers(1, 14))
    halves, anything = st.integers(-8, 8).map(lambda n: n / 2.0), st.floats(-1e3, 1e3, width=32)
    elements = data.draw(st.sampled_from([halves, anything]))
    heights = data.draw(arrays(np.float64, (rows, cols), elements=elements))
    place = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, cols - 1))
    eye_height = data.draw(st.sampled_from([0.0, 0.5, 2.0]))
    target_height = data.draw(st.sampled_from([0.0, 1.0]))
    ours = viewshed(heights, *place, eye_height, target_height)
    assert np.array_equal(ours, plain_viewshed(heights, *place, eye_height, target_height))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_the_smallest_grids_are_grids(shape):
    assert viewshed(np.zeros(shape), shape[0] - 1, 0, 1.0).all()


def test_the_own_cell_and_its_neighbours_are_always_seen():
    heights = 50.0 * np.random.default_rng(1).normal(size=(9, 9))
    assert viewshed(heights, 4, 4, 0.0)[3:6, 3:6].all()


@pytest.mark.parametrize("above, hidden", [(0.0, False), (0.5e-9, False), (2e-9, True)])
def test_touching_does_not_hide(above, hidden):
    heights = np.zeros((1, 5))
    heights[0, 2] = 1.0 + above  # on the line from an eye 2 m high to the ground at the end
    assert viewshed(heights, 0, 0, 2.0)[0, 4] != hidden


def test_a_wall_is_seen_and_hides_what_is_behind_it():
    heights = np.zeros((5, 9))
    heights[:, 4] = 3.0
    assert viewshed(heights, 2, 0, 1.7).all(axis=0).tolist() == [True] * 5 + [False] * 4


def test_the_target_stands_at_the_tested_cell_alone():
    heights = np.zeros((1, 9))
    heights[0, 4] = 3.0
    seen = viewshed(heights, 0, 0, 1.7, target_height=4.5)
    assert seen.tolist() == [[True] * 9]
    assert viewshed(heights, 0, 0, 1.7, target_height=4.0).tolist() == [[True] * 8 + [False]]


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), lift=st.floats(0.0, 5.0))
def test_a_higher_eye_and_a_higher_target_see_no_less(seed, lift):
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=(20, 15))
    low = viewshed(heights, 7, 4, 1.0, 0.5)
    assert not (low & ~viewshed(heights, 7, 4, 1.0 + lift, 0.5)).any()
    assert not (low & ~viewshed(heights, 7, 4, 1.0, 0.5 + lift)).any()


def test_every_direction_is_treated_alike():
    heights = np.random.default_rng(2).integers(0, 4, (21, 34)).astype(float)
    seen = viewshed(heights, 5, 20, 1.5)
    assert np.array_equal(viewshed(heights[::-1], 15, 20, 1.5), seen[::-1])
    assert np.array_equal(viewshed(heights[:, ::-1], 5, 13, 1.5), seen[:, ::-1])
    assert np.array_equal(viewshed(heights.T, 20, 5, 1.5), seen.T)


@pytest.mark.parametrize("threads", [1, 2, 3, 40])
def test_threads_do_not_change_what_is_seen(threads):
    heights = fractal(np.random.default_rng(3), 32, 30)
    observers = [(0, 0, 1.7), (20, 11, 4.0), (31, 29, 0.0), (20, 11, 8.0)]
    together = viewsheds(heights, observers, 0.4, threads=threads)
    assert np.array_equal(together, [viewshed(heights, *observer, 0.4) for observer in observers])


def test_nobody_sees_nothing():
    assert viewsheds(np.zeros((4, 6)), []).shape == (0, 4, 6)


@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_any_kind_of_number_and_any_view_of_an_array_will_do(dtype):
    heights = np.random.default_rng(4).integers(0, 9, (24, 30)).astype(dtype)
    kept = heights.copy()
    seen = viewshed(heights[::2, 5:], 3, 7, 1.7)
    assert np.array_equal(seen, viewshed(heights[::2, 5:].astype(float), 3, 7, 1.7))
    assert np.array_equal(heights, kept)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"heights": np.zeros(4)}, "grid of rows and columns"),
        ({"heights": np.zeros((0, 4))}, "grid of rows and columns"),
        ({"heights": np.array([[0.0, 1.0], [math.nan, 2.0]])}, "row 1, column 0"),
        ({"heights": np.array([[0.0, math.inf]])}, "row 0, column 1"),
        ({"row": 4}, "outside the grid of 4 rows and 6 columns"),
        ({"column": -1}, "outside the grid"),
        ({"row": 1.5}, "whole numbers"),
        ({"eye_height": -0.1}, "eye height"),
        ({"eye_height": math.nan}, "eye height"),
        ({"target_height": -1.0}, "target height"),
    ],
)
def test_what_is_no_grid_or_no_place_is_refused_in_words(change, words):
    call = {"heights": np.zeros((4, 6)), "row": 1, "column": 2, "eye_height": 1.7} | change
    with pytest.raises(ValueError, match=words):
        viewshed(**call)
