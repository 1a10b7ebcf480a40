import math

import numpy as np
import pytest
from surveys import EAST, NORTH, crown_points, ground_points, hill_pixels, write_geotiff, write_las

from scenes.catalogue import CoverKind
from scenes.ground import MISSING
from scenes.scenario import MAX_COVER, Scenario, ScenarioError
from scenes.survey import import_survey
from scenes.terrain import QUALITIES, Quality, Surface
from scenes.traversability import reachable


def assert_drivable(scenario: Scenario) -> None:
    heightmap = scenario.terrain.heightmap()
    start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    assert 11.0 <= math.dist(start, goal) <= 16.0
    assert reachable(heightmap, scenario.cover, start, goal)
    for place in (start, goal):
        assert heightmap.quality_at(*place) is not Quality.MISSING
        assert heightmap.surface_at(*place) is not Surface.WATER


def test_a_geotiff_becomes_a_scenario_that_knows_where_it_lies(tmp_path):
    path = write_geotiff(tmp_path / "ridge.tif", hill_pixels(60, 60))
    scenario = import_survey(path)
    source = scenario.terrain.source
    assert (scenario.name, source.file, source.crs) == ("ridge", "ridge.tif", "EPSG:32632")
    assert (source.easting, source.northing) == (EAST, NORTH)
    assert scenario.terrain.heights.min() == 0.0
    heights = scenario.terrain.heightmap().height_at(0.0, 0.0) + source.elevation
    assert heights == pytest.approx(100.0, abs=0.02)
    assert scenario.observers == () and scenario.cover == ()
    assert_drivable(scenario)
    scenario.save(tmp_path / "ridge.json")
    assert Scenario.load(tmp_path / "ridge.json").to_json() == scenario.to_json()


def test_a_laser_survey_becomes_ground_and_trees(tmp_path):
    rng = np.random.default_rng(2)
    trees = np.concatenate([crown_points(rng, 10.0 * i - 20.0, 9.0, 8.0, 1.5) for i in range(5)])
    points = np.concatenate([ground_points(rng, 60.0, 6000), trees])
    path = write_las(tmp_path / "wood.laz", points, [2] * 6000 + [5] * len(trees))
    scenario = import_survey(path, resolution=0.5, name="A <wood>")
    assert scenario.name == "A wood"
    assert [c.kind for c in scenario.cover] == [CoverKind.TREE] * 5
    assert "5 trees" in scenario.description
    assert_drivable(scenario)


def test_content_counts_not_the_suffix(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(40, 40)).rename(tmp_path / "a.laz")
    assert import_survey(path).terrain.heights.shape == (41, 41)


def test_the_vertical_scale_stretches_ground_and_what_stands_on_it(tmp_path):
    rng = np.random.default_rng(2)
    tree = crown_points(rng, 0.0, 9.0, 8.0, 1.5)
    points = np.concatenate([ground_points(rng, 60.0, 6000), tree])
    path = write_las(tmp_path / "a.las", points, [2] * 6000 + [5] * len(tree))
    once, twice = import_survey(path), import_survey(path, vertical_scale=2.0)
    np.testing.assert_allclose(twice.terrain.heights, 2.0 * once.terrain.heights, atol=0.002)
    assert twice.cover[0].height == pytest.approx(2.0 * once.cover[0].height, abs=0.01)
    assert twice.terrain.source.vertical_scale == 2.0


def test_the_same_file_and_seed_give_the_same_scenario(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(60, 60))
    assert import_survey(path, seed=4).to_json() == import_survey(path, seed=4).to_json()


def test_more_objects_than_a_scenario_holds_leave_the_lowest_out_and_say_so(tmp_path):
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-100.0, 100.0, 4.0), np.arange(-100.0, 100.0, 4.0)))
    keep = np.hypot(x, y) > 12.0
    ground = np.column_stack([x, y, np.zeros(x.size)])
    tops = np.column_stack([x + 2.0, y + 2.0, 5.0 + np.arange(x.size) * 1e-3])[keep]
    path = write_las(tmp_path / "a.las", np.concatenate([ground, tops]), [2] * x.size + [5] * len(tops))
    scenario = import_survey(path)
    assert len(scenario.cover) == MAX_COVER
    assert "lowest objects were left out: a scenario holds the 2000 tallest" in scenario.description
    assert min(c.height for c in scenario.cover) > 5.0


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"resolution": 0.0}, "resolution must be 0.05 to 10 m"),
        ({"resolution": math.nan}, "resolution must be"),
        ({"vertical_scale": 0.0}, "vertical scale must be 0.01 to 100"),
        ({"vertical_scale": math.inf}, "vertical scale must be"),
        ({"crop": (0.0, 0.0, 0.0)}, "crop must be three finite numbers"),
        ({"crop": (0.0, math.nan, 5.0)}, "crop must be three finite numbers"),
        ({"crop": (0.0, 1e300, 5.0)}, "is not in the survey: it spans"),
        ({"crop": (0.0, 0.0, 3.0)}, "at least 8 a side"),
        ({"crop": (0.0, 0.0, 1e300)}, "at most 1024 a side: crop to"),
        ({"resolution": 10.0}, "at least 8 a side"),
    ],
)
def test_a_wish_that_cannot_be_met_is_refused_with_what_would_be_right(tmp_path, wish, message):
    path = write_geotiff(tmp_path / "a.tif", hill_pixels(40, 40))
    with pytest.raises(ScenarioError, match=f"^a.tif: .*{message}"):
        import_survey(path, **wish)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "neither GeoTIFF nor LAS/LAZ"),
        (b"<VRTDataset/>", "neither GeoTIFF nor LAS/LAZ"),
        (b"LASF", "truncated"),
        (b"II*\0", "damaged or no GeoTIFF"),
        (b"II+\0" + b"\xff" * 500, "damaged or no GeoTIFF"),
        (b"LASF" + b"\xff" * 500, "not a usable number"),
    ],
)
def test_what_is_no_survey_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "a.tif"
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match=message) as caught:
        import_survey(path)
    assert "\n" not in str(caught.value)


def test_ground_returns_too_far_apart_are_refused(tmp_path):
    points = np.array([[0.0, 0.0, 1.0], [30.0, 0.0, 1.0], [15.0, 30.0, 1.0]])
    with pytest.raises(ScenarioError, match="too far apart"):
        import_survey(write_las(tmp_path / "three.las", points, 2))


def test_an_absent_file_a_folder_and_a_huge_file_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        import_survey(tmp_path / "none.laz")
    with pytest.raises(ScenarioError, match="is not a file"):
        import_survey(tmp_path)
    with (tmp_path / "huge.tif").open("wb") as stream:
        stream.truncate(3 * 2**30)
    with pytest.raises(ScenarioError, match="at most 2 GiB"):
        import_survey(tmp_path / "huge.tif")


def test_ground_too_steep_to_drive_on_is_refused(tmp_path):
    pixels = np.broadcast_to(np.arange(40.0, dtype=np.float32) * 2.0, (40, 40)).copy()
    with pytest.raises(ScenarioError, match="no start and goal 12 m apart"):
        import_survey(write_geotiff(tmp_path / "a.tif", pixels))


def test_a_hundred_metres_of_the_real_survey(survey_file):
    scenario = import_survey(survey_file, crop=(273500.0, 5274500.0, 100.0))
    heightmap = scenario.terrain.heightmap()
    assert heightmap.bounds == (-50.0, 50.0, -50.0, 50.0)
    assert 10.0 < heightmap.relief < 41.0
    trees = [c for c in scenario.cover if c.kind is CoverKind.TREE]
    assert 200 < len(trees) < 900 and max(t.height for t in trees) < 25.0
    assert (heightmap.quality == MISSING).mean() < 0.1
    assert Surface.WATER in {Surface(s) for row in scenario.terrain.surface for s in set(row)}
    assert scenario.terrain.source.crs == "EPSG:2949"
    assert set(np.unique(heightmap.quality)) == set(range(len(QUALITIES)))
    assert_drivable(scenario)
