import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator

from scenes.ground import INTERPOLATED, MEASURED, MISSING, connected, fill_gaps, interpolate


def plane(rows, cols):
    r, c = np.mgrid[:rows, :cols].astype(float)
    return 3.0 + 0.2 * r - 0.1 * c


def test_a_whole_grid_stays_as_it_is():
    heights, quality = fill_gaps(plane(8, 9), 1.0, 3.0)
    np.testing.assert_array_equal(heights, plane(8, 9))
    assert (quality == MEASURED).all()


@given(st.integers(1, 5), st.floats(0.25, 2.0))
def test_a_gap_in_a_plane_is_the_plane(width, resolution):
    heights = plane(20, 20)
    heights[5 : 5 + width, 6 : 6 + width] = np.nan
    filled, quality = fill_gaps(heights, resolution, 10.0)
    np.testing.assert_allclose(filled, plane(20, 20), atol=1e-9)
    assert (quality == INTERPOLATED).sum() == width**2


def test_a_wide_gap_and_the_outside_are_missing_and_take_the_nearest_height():
    heights = np.full((40, 40), np.nan)
    heights[:, :10], heights[:, 30:35] = 1.0, 5.0
    filled, quality = fill_gaps(heights, 1.0, 4.0)
    assert (quality[:, 10:30] == MISSING).all() and (quality[:, 35:] == MISSING).all()
    assert (filled[:, 10:19] == 1.0).all() and (filled[:, 21:] == 5.0).all()


@pytest.mark.parametrize("known", [[(4, 4)], [(4, 4), (4, 5)], [(r, 3) for r in range(8)]])
def test_what_spans_no_triangle_interpolates_nothing(known):
    heights = np.full((8, 8), np.nan)
    for cell in known:
        heights[cell] = 2.0
    filled, quality = fill_gaps(heights, 1.0, 3.0)
    assert (filled == 2.0).all() and (quality != INTERPOLATED).all()


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(4, 60))
def test_triangles_are_drawn_as_scipy_interpolates(seed, count):
    rng = np.random.default_rng(seed)
    points, heights = rng.uniform(-2.0, 14.0, (count, 2)), rng.normal(size=count)
    drawn = interpolate(points, heights, (12, 11), 1e9)
    cells = np.argwhere(np.ones((12, 11), bool))
    reference = LinearNDInterpolator(points, heights)(cells).reshape(12, 11)
    both = np.isfinite(drawn) & np.isfinite(reference)
    assert (np.isfinite(drawn) ^ np.isfinite(reference)).sum() <= 1  # a cell on the hull itself
    np.testing.assert_allclose(drawn[both], reference[both], atol=1e-7)


def test_patches_touch_by_corners_unless_told_otherwise():
    cells = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0]], bool)
    assert connected(cells)[1] == 1
    assert connected(cells, corners=False)[1] == 2
