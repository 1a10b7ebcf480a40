import struct

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import CRS, Transformer
from surveys import EAST, NORTH, US_FEET, ground_points, write_las

from scenes.point_cloud import read_points
from scenes.scenario import ScenarioError


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("version", ["1.2", "1.4"])
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_points_come_back_about_the_middle_of_the_survey(tmp_path, rng, version, suffix):
    points = ground_points(rng, 60.0, 500)
    points[:2, :2] = [[-30.0, -30.0], [30.0, 30.0]]
    classes = rng.integers(1, 7, 500)
    cloud = read_points(write_las(tmp_path / f"a.{suffix}", points, classes, version=version), None)
    np.testing.assert_allclose(np.column_stack([cloud.x, cloud.y, cloud.z]), points, atol=0.002)
    np.testing.assert_array_equal(cloud.classes, classes)
    assert (cloud.region.easting, cloud.region.northing) == pytest.approx((EAST, NORTH), abs=0.01)
    assert cloud.reference.label == "EPSG:32632"


def with_extended_records(path, *records):
    """Put records (user, number, content) behind the points, as a writer does that learns them last."""
    content = bytearray(path.read_bytes())
    struct.pack_into("<QI", content, 235, len(content), len(records))
    for user, number, data in records:
        content += struct.pack("<H16sHQ32s", 0, user, number, len(data), b"") + data
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_a_coordinate_system_behind_the_points_is_read(tmp_path, rng, suffix):
    path = write_las(tmp_path / f"a.{suffix}", ground_points(rng, 60.0, 500), 2, crs=None)
    wkt = CRS.from_epsg(32632).to_wkt("WKT1_GDAL").encode() + b"\0"
    with_extended_records(path, (b"LASF_Spec", 65535, b"waves" * 99), (b"LASF_Projection", 2112, wkt))
    assert read_points(path, None).reference.label == "EPSG:32632"


def test_extended_records_beyond_the_file_are_refused(tmp_path, rng):
    path = write_las(tmp_path / "a.las", ground_points(rng, 60.0, 500), 2)
    content = bytearray(with_extended_records(path, (b"LASF_Projection", 2112, b"x")).read_bytes())
    for where, count in ((2**63, 1), (len(content) - 8, 1), (len(content) - 61, 2**32 - 1)):
        struct.pack_into("<QI", content, 235, where, count)
        path.write_bytes(content)
        with pytest.raises(ScenarioError, match="extended record"):
            read_points(path, None)


@pytest.mark.parametrize("crop", [(EAST + 5.0, NORTH - 4.0, 20.0), (5.0, -4.0, 20.0)])
def test_a_crop_is_named_by_coordinates_or_by_metres_from_the_middle(tmp_path, rng, crop):
    points = ground_points(rng, 200.0, 4000)
    points[:2, :2] = [[-100.0, -100.0], [100.0, 100.0]]
    cloud = read_points(write_las(tmp_path / "a.laz", points, 2), crop)
    near = np.abs(points[:, :2] - (5.0, -4.0)).max(axis=1)
    assert abs(len(cloud.x) - (near <= 25.0).sum()) <= 1  # the square and 15 m about it
    assert cloud.region.easting == pytest.approx(EAST + 5.0, abs=0.01)


def test_a_crop_elsewhere_is_refused_with_the_right_range(tmp_path, rng):
    path = write_las(tmp_path / "a.laz", ground_points(rng, 60.0, 500), 2)
    with pytest.raises(ScenarioError, match=r"spans 49\d+.* to 500\d+.* east and 49\d+.* to 500\d+.* north"):
        read_points(path, (EAST + 1000.0, NORTH, 20.0))


def test_feet_become_metres_and_degrees_become_utm(tmp_path, rng):
    points = ground_points(rng, 600.0, 500) + np.array([1e6, 2e5, 0.0])
    cloud = read_points(write_las(tmp_path / "a.las", points, 2, crs=US_FEET), None)
    assert np.ptp(cloud.x) == pytest.approx(0.3048006 * np.ptp(points[:, 0]), rel=1e-4)
    assert np.ptp(cloud.z) == pytest.approx(0.3048006 * np.ptp(points[:, 2]), rel=1e-3)
    lon, lat = Transformer.from_crs(32632, 4326, always_xy=True).transform(EAST, NORTH)
    spread = rng.uniform(-1e-3, 1e-3, (500, 2))
    degrees = np.column_stack([lon + spread[:, 0], lat + spread[:, 1], np.full(500, 50.0)])
    cloud = read_points(write_las(tmp_path / "b.las", degrees, 2, crs="EPSG:4326"), None)
    assert cloud.reference.label == "EPSG:32632"
    assert cloud.region.easting == pytest.approx(EAST, abs=10.0)
    assert cloud.z.mean() == pytest.approx(50.0)


def test_noise_and_withheld_returns_are_left_out(tmp_path, rng):
    path = write_las(tmp_path / "a.las", ground_points(rng, 60.0, 100), [7] * 10 + [18] * 10 + [2] * 80)
    las = laspy.read(path)
    las.withheld = np.arange(100) >= 95
    las.write(path)
    assert len(read_points(path, None).x) == 75


def patch(offset: int, layout: str, *values):
    def apply(data: bytearray) -> bytearray:
        struct.pack_into(layout, data, offset, *values)
        return data

    return apply


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d[:100], "ends within its header"),
        (lambda d: d[:-3000], "truncated|damaged"),
        (lambda d: d[:400], "beyond the end|truncated"),
        (patch(247, "<Q", 2**40), "claims 1,099,511,627,776 points"),
        (patch(247, "<Q", 0), "no points"),
        (patch(131, "<d", float("nan")), "scale, offset or bound"),
        (patch(139, "<d", 0.0), "scale, offset or bound"),
        (patch(155, "<d", float("inf")), "scale, offset or bound"),
        (patch(100, "<I", 2**32 - 1), "beyond the end"),
        (patch(96, "<I", 2**31), "beyond the end"),
        (patch(105, "<H", 3), "damaged|point"),
    ],
)
@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_a_header_that_lies_is_refused(tmp_path, rng, damage, message, suffix):
    points = ground_points(rng, 60.0, 500)
    path = write_las(tmp_path / f"a.{suffix}", points, 2)
    data = bytearray(path.read_bytes())
    if struct.unpack_from("<I", data, 107)[0]:
        struct.pack_into("<I", data, 107, 0)  # the old 32-bit count would stand in for the 64-bit one
    path.write_bytes(damage(data))
    with pytest.raises(ScenarioError, match=message):
        read_points(path, None)


def test_a_table_of_more_chunks_than_the_file_can_hold_is_refused(tmp_path, rng):
    path = write_las(tmp_path / "a.laz", ground_points(rng, 60.0, 500), 2)
    data = bytearray(path.read_bytes())
    table = struct.unpack_from("<q", data, struct.unpack_from("<I", data, 96)[0])[0]
    struct.pack_into("<I", data, table + 4, 2**32 - 1)
    path.write_bytes(data)
    with pytest.raises(ScenarioError, match="compressed chunks do not fit"):
        read_points(path, None)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flips=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), min_size=1, max_size=8),
    cut=st.one_of(st.none(), st.integers(0, 3000)),
)
def test_flipped_bytes_end_in_points_or_a_scenario_error(tmp_path, flips, cut):
    sound = tmp_path / "sound.laz"
    if not sound.exists():
        write_las(sound, ground_points(np.random.default_rng(3), 60.0, 300), 2)
    data = bytearray(sound.read_bytes())[:cut]
    for place, value in flips:
        if data:
            data[place % len(data)] = value
    hostile = tmp_path / "hostile.laz"
    hostile.write_bytes(data)
    try:
        cloud = read_points(hostile, None)
    except ScenarioError:
        return
    assert np.isfinite(cloud.x).all() and len(cloud.x) == len(cloud.z) > 0
