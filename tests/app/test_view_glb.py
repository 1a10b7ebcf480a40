"""Meshes on their way to the browser: binary glTF and colours that survive the renderer."""

import io
import json
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from app.view.glb import Surface, glb, merged
from app.view.tone import for_screen, linear

SQUARE = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.5), (0.0, 1.0, 0.5)])
FACES = np.array([(0, 1, 2), (0, 2, 3)])
ORANGE = np.tile(np.array([240, 145, 40], np.uint8), (4, 1))


def parts(data: bytes) -> tuple[dict, bytes]:
    """The JSON and the binary chunk of a GLB file, its header checked."""
    magic, version, total = struct.unpack_from("<4sII", data)
    assert (magic, version, total) == (b"glTF", 2, len(data))
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and length % 4 == 0
    size, second = struct.unpack_from("<I4s", data, 20 + length)
    assert second == b"BIN\0" and size % 4 == 0
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_another_reader_finds_the_same_triangles():
    scene = trimesh.load_scene(io.BytesIO(glb(Surface(SQUARE, FACES, ORANGE))), file_type="glb")
    (mesh,) = scene.geometry.values()
    np.testing.assert_allclose(mesh.triangles, SQUARE[FACES])


def test_several_surfaces_are_several_meshes_of_one_file():
    document, _ = parts(glb(Surface(SQUARE, FACES), Surface(SQUARE + 1.0, FACES, unlit=True)))
    assert len(document["meshes"]) == len(document["scenes"][0]["nodes"]) == 2


def test_lit_colours_are_stored_as_linear_light_with_straight_alpha():
    rgba = np.tile(np.array([255, 128, 0, 51], np.uint8), (4, 1))
    document, binary = parts(glb(Surface(SQUARE, FACES, rgba, blended=True)))
    accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    view = document["bufferViews"][accessor["bufferView"]]
    stored = np.frombuffer(binary, "<u2", 16, view["byteOffset"]).reshape(4, 4)
    np.testing.assert_array_equal(stored[0], [65535, round(65535 * 0.21586), 0, 13107])
    assert document["materials"][0]["alphaMode"] == "BLEND"


def test_a_texture_travels_inside_the_file():
    with io.BytesIO() as buffer:
        Image.new("RGB", (4, 4), (10, 200, 30)).save(buffer, "PNG")
        image = buffer.getvalue()
    document, binary = parts(glb(Surface(SQUARE, FACES, uv=SQUARE[:, :2], texture=image)))
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    assert document["images"][0]["mimeType"] == "image/png"
    assert binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]] == image


def test_a_surface_without_triangles_is_refused():
    with pytest.raises(ValueError, match="at least one triangle"):
        glb(Surface(SQUARE, np.zeros((0, 3), int)))


def test_merging_keeps_every_triangle_and_its_colour():
    moved = Surface(SQUARE, FACES, 255 - ORANGE).moved(np.eye(3), np.array([0.0, 0.0, 3.0]))
    both = merged([Surface(SQUARE, FACES, ORANGE), moved])
    np.testing.assert_allclose(both.vertices[both.faces[2:]], SQUARE[FACES] + (0.0, 0.0, 3.0))
    assert both.colours is not None
    np.testing.assert_array_equal(both.colours[both.faces[0, 0]], ORANGE[0])
    np.testing.assert_array_equal(both.colours[both.faces[3, 0]], 255 - ORANGE[0])


def test_a_painted_mesh_keeps_the_colours_of_its_faces():
    box = trimesh.creation.box()
    box.visual.face_colors = np.arange(36).reshape(12, 3).repeat([1, 1, 1], axis=1)
    surface = Surface.from_trimesh(box)
    assert surface.colours is not None
    for face, colour in zip(surface.faces, box.visual.face_colors, strict=True):
        np.testing.assert_array_equal(surface.colours[face], np.tile(colour[:3], (3, 1)))


def film(colours: np.ndarray) -> np.ndarray:
    """What the renderer makes of sRGB colours: three.js' ACESFilmicToneMapping at exposure 1, as floats."""
    into = np.array([[0.59719, 0.35458, 0.04823], [0.076, 0.90834, 0.01566], [0.0284, 0.13383, 0.83777]])
    out = np.array(
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
    )
    v = linear(colours) / 0.6 @ into.T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081)
    light = np.clip(v @ out.T, 0.0, 1.0)
    return 255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@given(arrays(np.uint8, (8, 3), elements=st.integers(0, 255)))
def test_what_the_film_shows_is_sent_so_that_it_shows_again(colours):
    shown = np.round(film(colours)).astype(np.uint8)
    again = film(for_screen(shown))
    inside = (shown > 8).all(axis=1) & (colours < 250).all(axis=1) & (colours > 3).all(axis=1)
    np.testing.assert_allclose(again[inside], shown[inside], atol=6.0)


@pytest.mark.parametrize("colour", [(240, 145, 40), (38, 160, 150), (150, 152, 156), (72, 22, 124)])
def test_the_meaningful_colours_appear_as_in_the_legend(colour):
    np.testing.assert_allclose(film(for_screen(np.array([colour]))), [colour], atol=2.0)
