"""The height grid: where its samples lie, how the ground runs between them, how it is written down."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small import flat

from scenes.terrain import QUALITY_CODE, SURFACE_CODE, SURFACE_GROUP, Heightmap, Quality, Surface


def bumpy(rows: int = 9, cols: int = 13, resolution: float = 0.5) -> Heightmap:
    rng = np.random.default_rng(3)
    blank = np.zeros((rows, cols), np.uint8)
    return Heightmap(rng.normal(size=(rows, cols)), resolution, blank, blank)


def test_rows_run_north_and_columns_east_about_the_origin():
    ground = bumpy()
    assert ground.bounds == (-3.0, 3.0, -2.0, 2.0)
    assert ground.cell(-3.0, -2.0) == (0, 0)
    assert ground.cell(3.0, -2.0) == (0, 12)
    assert ground.cell(-3.0, 2.0) == (8, 0)
    assert ground.cell(99.0, 99.0) == (8, 12)
    x, y = ground.xy()
    assert x[0, -1] == 3.0 and y[-1, 0] == 2.0


def test_at_a_sample_the_ground_is_the_sample():
    ground = bumpy()
    assert np.allclose(ground.height_at(*ground.xy()), ground.heights, atol=1e-12)


def test_heights_agree_with_their_plain_twin():
    ground, draw = bumpy(), np.random.default_rng(5)
    x, y = draw.uniform(-4.0, 4.0, (2, 500))
    u = np.clip((x - ground.x_min) / ground.resolution, 0.0, 12.0)
    v = np.clip((y - ground.y_min) / ground.resolution, 0.0, 8.0)
    col, row = np.minimum(u.astype(int), 11), np.minimum(v.astype(int), 7)
    u, v, h = u - col, v - row, ground.heights
    near, far, east, north = h[row, col], h[row + 1, col + 1], h[row, col + 1], h[row + 1, col]
    lower = near + u * (east - near) + v * (north - near)
    upper = far + (1.0 - u) * (north - far) + (1.0 - v) * (east - far)
    np.testing.assert_array_equal(ground.height_at(x, y), np.where(u + v <= 1.0, lower, upper))


def test_heights_are_asked_for_in_any_shape_and_unknown_places_have_none():
    ground = bumpy()
    assert float(ground.height_at(1, -0.7)) == ground.height_at(np.array([[1.0]]), -0.7)[0, 0]
    assert ground.height_at(np.zeros((0, 2)), np.zeros((0, 2))).shape == (0, 2)
    assert np.isnan(ground.height_at(np.nan, 0.0))


@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_between_samples_the_ground_is_the_triangle_below(x, y):
    ground = bumpy()
    vertices, faces = ground.triangles()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = cross(b - a, c - a)
    u, v = cross((x, y, 0.0) - a, c - a) / area, cross(b - a, (x, y, 0.0) - a) / area
    (hits,) = np.nonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9))
    face = hits[0]
    height = a[face, 2] + u[face] * (b[face, 2] - a[face, 2]) + v[face] * (c[face, 2] - a[face, 2])
    assert ground.height_at(x, y) == pytest.approx(height, abs=1e-6)


def cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def test_beyond_the_edge_the_ground_goes_on_level():
    ground = bumpy()
    assert ground.height_at(50.0, 2.0) == pytest.approx(ground.heights[8, 12])
    assert not ground.contains(3.001, 0.0)


def test_faces_look_up():
    vertices, faces = bumpy().triangles()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert len(faces) == 2 * 8 * 12
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


def test_slope_of_a_plane():
    ground = flat()
    x, y = ground.xy()
    plane = Heightmap(0.3 * x - 0.4 * y, 0.5, ground.surface, ground.quality)
    assert np.allclose(plane.slope, np.arctan(0.5))


def test_letters_and_codes_are_each_other_s_inverse():
    rng = np.random.default_rng(1)
    surface = rng.integers(0, len(Surface), (9, 13)).astype(np.uint8)
    quality = rng.integers(0, len(Quality), (9, 13)).astype(np.uint8)
    ground = Heightmap(np.zeros((9, 13)), 0.5, surface, quality)
    again = Heightmap.from_symbols(
        ground.heights, 0.5, ground.surface_symbols(), ground.quality_symbols()
    )
    assert (again.surface == surface).all() and (again.quality == quality).all()
    assert flat().quality_symbols() is None


def test_what_lies_at_a_point():
    ground = flat()
    ground.surface[ground.cell(2.0, -3.0)] = SURFACE_CODE[Surface.MUD]
    ground.quality[ground.cell(2.0, -3.0)] = QUALITY_CODE[Quality.INTERPOLATED]
    assert ground.surface_at(2.1, -3.1) is Surface.MUD
    assert ground.quality_at(2.1, -3.1) is Quality.INTERPOLATED
    assert ground.surface_at(0.0, 0.0) is Surface.GRASS


def test_every_surface_has_a_group():
    assert set(SURFACE_GROUP) == set(Surface)
