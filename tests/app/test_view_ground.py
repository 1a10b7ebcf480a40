"""The drawn ground: where it lies, what it shows of surface, relief and missing data."""

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

from app.view import palette
from app.view.ground import MAX_DRAWN, coarsened, jpeg, painted, terrain_glb, water_glb
from scenes.terrain import QUALITIES, SURFACES, Heightmap, Quality, Surface


def ground(rows: int = 24, cols: int = 40, resolution: float = 0.5, **cells) -> Heightmap:
    y, x = np.mgrid[0:rows, 0:cols]
    return Heightmap(
        cells.get("heights", 0.3 * np.sin(0.4 * x) + 0.05 * y),
        resolution,
        cells.get("surface", np.zeros((rows, cols), np.uint8)),
        cells.get("quality", np.zeros((rows, cols), np.uint8)),
    )


def picture(heightmap: Heightmap) -> np.ndarray:
    """The painted texture, south first like the map."""
    return np.asarray(Image.open(io.BytesIO(jpeg(painted(heightmap)))), float)[::-1]


def test_the_relief_has_the_map_s_own_triangles():
    heightmap = ground()
    scene = trimesh.load_scene(io.BytesIO(terrain_glb(heightmap, painted(heightmap))), file_type="glb")
    relief = max(scene.geometry.values(), key=lambda mesh: len(mesh.faces))
    vertices, faces = heightmap.triangles()
    np.testing.assert_allclose(relief.triangles, vertices[faces], atol=1e-5)


def test_a_large_map_is_drawn_coarser_over_the_same_bounds():
    rows, cols = 500, 900
    y, x = np.mgrid[0:rows, 0:cols]
    heightmap = ground(rows, cols, heights=0.01 * x - 0.02 * y)
    drawn = coarsened(heightmap)
    assert max(drawn.shape) <= MAX_DRAWN + 1
    np.testing.assert_allclose(drawn.bounds, heightmap.bounds, rtol=0.01)
    spots = np.random.default_rng(0).uniform(-90, 90, (50, 2))
    np.testing.assert_allclose(drawn.height_at(*spots.T), heightmap.height_at(*spots.T), atol=0.1)


def test_each_surface_has_its_own_colour_where_it_lies():
    surface = np.zeros((40, 40), np.uint8)
    surface[:, 20:] = SURFACES.index(Surface.SAND)
    image = picture(ground(40, 40, heights=np.zeros((40, 40)), surface=surface))
    width = image.shape[1]
    west, east = image[:, : width // 3].mean(axis=(0, 1)), image[:, -width // 3 :].mean(axis=(0, 1))
    np.testing.assert_allclose(west, palette.GROUND[Surface.GRASS], atol=8)
    np.testing.assert_allclose(east, palette.GROUND[Surface.SAND], atol=8)


def test_slopes_toward_the_sun_are_lighter():
    _, x = np.mgrid[0:40, 0:40]
    image = picture(ground(40, 40, heights=0.2 * np.abs(x - 20.0)))
    half = image.shape[1] // 2
    assert (
        image[:, half + 20 :].mean() > image[:, : half - 20].mean() + 10
    )  # the sun stands in the north-west


def test_cells_without_data_are_plain_grey():
    quality = np.zeros((40, 40), np.uint8)
    quality[:20] = QUALITIES.index(Quality.MISSING)
    image = picture(ground(40, 40, heights=np.zeros((40, 40)), quality=quality))
    south = image[: image.shape[0] // 3]
    assert np.ptp(south.mean(axis=(0, 1))) < 8 and abs(south.mean() - np.mean(palette.NO_DATA)) < 15


def test_the_same_map_is_painted_the_same():
    assert np.array_equal(painted(ground()), painted(ground()))


def test_water_is_a_level_sheet_over_the_wet_cells_alone():
    surface = np.zeros((24, 40), np.uint8)
    surface[5:9, 10:16] = SURFACES.index(Surface.WATER)
    heightmap = ground(heights=np.full((24, 40), 1.5), surface=surface)
    data = water_glb(heightmap)
    assert data is not None
    sheet = trimesh.load_mesh(io.BytesIO(data), file_type="glb")
    assert sheet.area == pytest.approx(24 * 0.25)
    np.testing.assert_allclose(sheet.vertices[:, 2], 1.53, atol=1e-5)
    assert heightmap.surface_at(*sheet.centroid[:2]) is Surface.WATER


def test_a_dry_map_has_no_sheet():
    assert water_glb(ground()) is None
