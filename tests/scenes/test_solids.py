"""The solids that meshes are made of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.solids import Solid, ball, box, column, extrusion, frustum, panel, wheel

GREY = (120, 120, 120)
CLOSED = {
    "box": box((1.0, 2.0, 3.0), (0.5, 1.5, 2.5), GREY),
    "frustum": frustum((2.0, 1.0), (1.0, 0.4), (0.2, 1.4), GREY),
    "extrusion": extrusion([(-1.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 2.0), (-1.0, 1.0)], 1.5, GREY),
    "column": column(0.5, (-1.0, 2.0), GREY),
    "tapered column": column(0.5, (-1.0, 2.0), GREY, top=0.2, sides=5),
    "cone": column(0.5, (-1.0, 2.0), GREY, top=0.0, sides=8),
    "ball": ball((1.0, 2.0, 0.5), (3.0, 0.0, 1.0), GREY),
    "small ball": ball((1.0, 2.0, 0.5), (3.0, 0.0, 1.0), GREY, subdivisions=0),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_solids_are_watertight_and_look_outward(name):
    mesh = CLOSED[name].mesh()
    mesh.merge_vertices(digits_vertex=6, merge_tex=True, merge_norm=True)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0


@pytest.mark.parametrize(
    ("name", "volume"),
    [
        ("box", 0.5 * 1.5 * 2.5),
        ("extrusion", 3.0 * 3.0),
        ("cone", 3.0 / 3.0 * 0.5 * 8 * 0.25 * np.sin(np.pi / 4)),
    ],
)
def test_volumes(name, volume):
    assert CLOSED[name].mesh().volume == pytest.approx(volume)


def test_a_dented_ball_stays_within_its_size():
    points = ball((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), GREY, np.random.default_rng(1), 0.2).triangles
    reach = np.linalg.norm(points.reshape(-1, 3), axis=1)
    assert reach.max() <= 1.0 + 1e-9 and reach.min() >= 0.8 - 1e-9


@pytest.mark.parametrize("normal", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_panel_looks_along_its_normal(normal):
    mesh = panel((1.0, 2.0, 3.0), normal, (0.8, 1.6), GREY).mesh()
    assert np.allclose(mesh.face_normals, (*normal, 0.0))
    assert mesh.area == pytest.approx(0.8 * 1.6)


def test_a_wheel_stands_on_the_ground_across_the_drive():
    low, high = wheel((0.0, 1.0, 0.3), 0.3, 0.2, GREY).mesh().bounds
    assert low[2] == pytest.approx(0.0) and high[2] == pytest.approx(0.6)
    assert high[1] - low[1] == pytest.approx(0.2, rel=0.1)


@given(st.floats(0.1, 50.0), st.floats(0.1, 50.0), st.floats(0.1, 50.0))
def test_fitting_keeps_the_depth_below_ground(length, width, height):
    points = CLOSED["column"].fitted(length, width, height).triangles.reshape(-1, 3)
    assert np.ptp(points, axis=0) == pytest.approx([length, width, height + 1.0])
    assert points[:, 2].min() == -1.0


@pytest.mark.parametrize(
    "shade", [lambda s: s.mottled(np.random.default_rng(1), 0.5), lambda s: s.shaded(0, 3)]
)
def test_shades_stay_colours(shade):
    colours = shade(CLOSED["ball"]).colours
    assert colours.min() >= 0.0 and colours.max() <= 255.0 and len(np.unique(colours)) > 1


def test_each_face_has_vertices_and_a_colour_of_its_own():
    two_tone = Solid(CLOSED["cone"].triangles, np.linspace(0, 255, 14)[:, None] * np.ones(3))
    mesh = two_tone.mesh()
    assert len(mesh.vertices) == 3 * len(mesh.faces)
    assert (mesh.visual.vertex_colors[::3, :3] == mesh.visual.vertex_colors[2::3, :3]).all()
