import numpy as np
import pytest
import rasterio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import Transformer
from rasterio import Affine
from rasterio.enums import ColorInterp
from rasterio.transform import from_origin
from surveys import EAST, NORTH, US_FEET, hill, hill_pixels, write_geotiff

from scenes.geotiff import read_geotiff
from scenes.ground import INTERPOLATED, MEASURED, MISSING
from scenes.scenario import ScenarioError


def true_heights(ground):
    east, north = ground.grid.to_survey(*ground.grid.xy())
    return hill(east - EAST, north - NORTH)


def inner(cells: np.ndarray, rim: int = 3) -> np.ndarray:
    return cells[rim:-rim, rim:-rim]


def test_heights_land_where_they_were_measured_row_zero_south(tmp_path):
    ground = read_geotiff(write_geotiff(tmp_path / "a.tif", hill_pixels(60, 80)), None, None)
    assert ground.grid.resolution == 1.0
    assert ground.heights.shape == (61, 81)
    np.testing.assert_allclose(inner(ground.heights), inner(true_heights(ground)), atol=0.01)
    assert (inner(ground.quality) == MEASURED).all()
    assert ground.reference.label == "EPSG:32632"


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    pixel=st.floats(0.3, 3.0),
    resolution=st.floats(0.5, 2.0),
    turn=st.floats(-180.0, 180.0),
    x=st.floats(-5.0, 5.0),
    y=st.floats(-5.0, 5.0),
)
def test_any_pixel_size_rotation_crop_and_resolution_keep_the_ground(tmp_path, pixel, resolution, turn, x, y):
    cells = 20 + int(90 / pixel)
    cos, sin, half = pixel * np.cos(np.radians(turn)), pixel * np.sin(np.radians(turn)), 0.5 * cells
    rotation = Affine(
        cos, sin, EAST - half * (cos + sin), sin, -cos, NORTH - half * (sin - cos)
    )
    c, r = np.meshgrid(np.arange(cells) + 0.5 - half, np.arange(cells) + 0.5 - half)
    heights = hill(cos * c + sin * r, sin * c - cos * r)
    path = write_geotiff(tmp_path / "a.tif", heights, transform=rotation)
    ground = read_geotiff(path, (EAST + x, NORTH + y, 40.0), resolution)
    np.testing.assert_allclose(ground.heights, true_heights(ground), atol=0.02)
    assert not (ground.quality == MISSING).any()


def test_small_holes_are_interpolated_and_large_ones_missing_without_the_sentinel_leaking(tmp_path):
    pixels = hill_pixels(60, 60)
    pixels[10:12, 10:12] = -9999.0
    pixels[25:50, 25:50] = np.nan
    ground = read_geotiff(write_geotiff(tmp_path / "a.tif", pixels, nodata=-9999.0), None, None)
    assert np.isfinite(ground.heights).all() and ground.heights.min() > 90.0
    north = ground.heights.shape[0] - 1
    assert ground.quality[north - 11, 11] == INTERPOLATED
    assert ground.quality[north - 37, 37] == MISSING
    known = inner(ground.quality != MISSING)
    np.testing.assert_allclose(inner(ground.heights)[known], inner(true_heights(ground))[known], atol=0.2)


@pytest.mark.parametrize("sentinel", [-9999.0, -32768.0, 3.4e38, np.inf, -3.4028235e38])
def test_undeclared_sentinels_count_as_missing(tmp_path, sentinel):
    pixels = hill_pixels(40, 40)
    pixels[5:30, 5:30] = sentinel
    ground = read_geotiff(write_geotiff(tmp_path / "a.tif", pixels), None, 2.0)
    assert (ground.quality == MISSING).any()
    assert ground.heights.min() > 90.0 and ground.heights.max() < 110.0


@pytest.mark.parametrize("pattern", ["half of the pixels", "every second row", "checkerboard"])
def test_scattered_holes_are_bridged_wherever_they_lie(tmp_path, pattern):
    pixels = hill_pixels(60, 60)
    row, col = np.indices(pixels.shape)
    holes = {
        "half of the pixels": np.random.default_rng(3).random(pixels.shape) < 0.5,
        "every second row": row % 2 == 1,
        "checkerboard": (row + col) % 2 == 1,
    }[pattern]
    pixels[holes] = -9999.0
    ground = read_geotiff(write_geotiff(tmp_path / "a.tif", pixels, nodata=-9999.0), None, None)
    assert (inner(ground.quality) == MISSING).mean() < 0.01
    assert (inner(ground.quality) == INTERPOLATED).mean() > 0.4
    np.testing.assert_allclose(inner(ground.heights), inner(true_heights(ground)), atol=0.15)


def test_between_coarse_pixels_heights_are_interpolated(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(20, 20, 10.0), pixel=10.0)
    ground = read_geotiff(path, None, None)
    assert ground.grid.resolution == 2.0
    assert (inner(ground.quality, 6) == INTERPOLATED).mean() > 0.7


def test_a_geographic_raster_becomes_metric_utm(tmp_path):
    to_utm = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    lon, lat = to_utm.transform(EAST, NORTH, direction="INVERSE")
    step = 1e-5
    transform = from_origin(lon - 60 * step, lat + 60 * step, step, step)
    c, r = np.meshgrid(np.arange(120) + 0.5, np.arange(120) + 0.5)
    east, north = to_utm.transform(transform.c + c * step, transform.f - r * step)
    heights = hill(np.asarray(east) - EAST, np.asarray(north) - NORTH)
    path = write_geotiff(tmp_path / "a.tif", heights, transform=transform, crs="EPSG:4326")
    ground = read_geotiff(path, (EAST, NORTH, 50.0), 0.5)
    assert ground.reference.label == "EPSG:32632"
    np.testing.assert_allclose(ground.heights, true_heights(ground), atol=0.02)
    by_degrees = read_geotiff(path, (lon, lat, 50.0), 0.5)
    np.testing.assert_allclose(by_degrees.heights, ground.heights, atol=1e-3)


def test_web_mercator_is_not_taken_for_metres(tmp_path):
    to_web = Transformer.from_crs("EPSG:32632", "EPSG:3857", always_xy=True)
    x, y = to_web.transform(EAST, NORTH)
    path = write_geotiff(
        tmp_path / "a.tif", hill_pixels(80, 80), crs="EPSG:3857", transform=from_origin(x - 40, y + 40, 1, 1)
    )
    ground = read_geotiff(path, None, None)
    assert ground.reference.label == "EPSG:32632"
    assert 52.0 < 2.0 * ground.grid.half_width < 62.0  # 80 units are 57 m on the ground at 45° north


def test_feet_become_metres_both_ways(tmp_path):
    there = from_origin(1_000_000, 200_000, 1, 1)
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(200, 200), crs=US_FEET, transform=there)
    ground = read_geotiff(path, None, None)
    assert 2.0 * ground.grid.half_width == pytest.approx(200 * 0.3048006, abs=0.5)
    assert ground.heights.mean() == pytest.approx(100 * 0.3048006, abs=0.5)


@pytest.mark.parametrize(("unit", "metres"), [("metre", 1.0), ("ft", 0.3048), ("US survey foot", 0.3048006)])
def test_the_bands_own_unit_wins(tmp_path, unit, metres):
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(30, 30), units=[unit])
    assert read_geotiff(path, None, None).heights.mean() == pytest.approx(100 * metres, rel=0.02)


def test_integers_with_scale_and_offset(tmp_path):
    counts = np.rint((hill_pixels(30, 30) - 50.0) / 0.01).astype(np.int16)
    ground = read_geotiff(
        write_geotiff(tmp_path / "a.tif", counts, scales=[0.01], offsets=[50.0], nodata=-32768), None, None
    )
    np.testing.assert_allclose(inner(ground.heights), inner(true_heights(ground)), atol=0.02)


def test_band_one_is_the_elevation(tmp_path):
    pixels = hill_pixels(30, 30)
    path = write_geotiff(tmp_path / "a.tif", np.stack([pixels, 0 * pixels]))
    assert read_geotiff(path, None, None).heights.mean() == pytest.approx(100.0, abs=1.0)


def test_a_large_sparse_raster_is_read_only_where_asked(tmp_path):
    path = tmp_path / "a.tif"
    profile = {"count": 1, "height": 200_000, "width": 200_000, "dtype": "float32", "tiled": True}
    transform = from_origin(EAST - 100_000, NORTH + 100_000, 1, 1)
    with rasterio.open(
        path, "w", driver="GTiff", crs="EPSG:32632", transform=transform, nodata=-1, sparse_ok=True,
        bigtiff="YES", compress="deflate", **profile,
    ) as raster:  # fmt: skip
        raster.write(hill_pixels(256, 256), 1, window=((99_872, 100_128), (99_872, 100_128)))
    ground = read_geotiff(path, (EAST, NORTH, 100.0), None)
    np.testing.assert_allclose(ground.heights, true_heights(ground), atol=0.01)
    with pytest.raises(ScenarioError, match="every pixel there is nodata"):
        read_geotiff(path, (EAST + 90_000, NORTH, 100.0), None)
    with pytest.raises(ScenarioError, match="crop to 2046 m or less"):
        read_geotiff(path, None, None)


def picture(path):
    write_geotiff(path, np.zeros((3, 30, 30), np.uint8), photometric="RGB")
    with rasterio.open(path) as raster:
        assert raster.colorinterp[0] is ColorInterp.red


def no_data_at_all(path):
    write_geotiff(path, np.full((30, 30), -9999.0, np.float32), nodata=-9999.0)


def truncated(path):
    write_geotiff(path, np.random.default_rng(1).random((200, 200)).astype(np.float32))
    path.write_bytes(path.read_bytes()[:4000])


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_an_ungeoreferenced_raster_is_refused(tmp_path):
    write_geotiff(tmp_path / "a.tif", hill_pixels(30, 30), crs=None, transform=Affine.identity())
    with pytest.raises(ScenarioError, match="no georeference"):
        read_geotiff(tmp_path / "a.tif", None, None)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (picture, "is red: this is a picture"),
        (no_data_at_all, "every pixel there is nodata"),
        (truncated, "damaged or no GeoTIFF"),
        (lambda p: write_geotiff(p, np.zeros((30, 30), np.complex64)), "holds complex64 numbers"),
        (lambda p: write_geotiff(p, hill_pixels(4, 4)), "at least 8 a side"),
        (lambda p: write_geotiff(p, hill_pixels(30, 30), scales=[np.nan], offsets=[0.0]), "has scale nan"),
    ],
)
def test_what_is_no_elevation_model_is_refused(tmp_path, make, message):
    make(tmp_path / "a.tif")
    with pytest.raises(ScenarioError, match=message):
        read_geotiff(tmp_path / "a.tif", None, None)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 600), st.integers(0, 255)), min_size=1, max_size=8))
def test_flipped_bytes_end_in_a_ground_or_a_scenario_error(tmp_path, flips):
    sound = tmp_path / "sound.tif"
    if not sound.exists():
        write_geotiff(sound, hill_pixels(30, 30), compress="deflate")
    data = bytearray(sound.read_bytes())
    for place, value in flips:
        data[place % len(data)] = value
    hostile = tmp_path / "hostile.tif"
    hostile.write_bytes(data)
    try:
        ground = read_geotiff(hostile, None, None)
    except ScenarioError:
        return
    assert np.isfinite(ground.heights).all()
