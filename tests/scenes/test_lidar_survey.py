import numpy as np
import pytest
from surveys import ground_points, hill, write_las

from scenes.ground import INTERPOLATED, MEASURED, MISSING
from scenes.lidar_survey import WATER_INDEX, ground_from_points
from scenes.point_cloud import read_points
from scenes.scenario import ScenarioError
from scenes.terrain import SURFACES, Surface

SIZE = 60.0


def ground_of(tmp_path, points, classes, resolution=None, crop=None):
    return ground_from_points(read_points(write_las(tmp_path / "a.las", points, classes), crop), resolution)


def spread(rng, count=8000):
    points = ground_points(rng, SIZE, count)
    points[:4, :2] = 0.5 * SIZE * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    points[:, 2] = hill(points[:, 0], points[:, 1])
    return points


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.mark.parametrize(("count", "resolution"), [(8000, 0.25), (1600, 0.5), (400, 1.0)])
def test_heights_follow_the_ground_and_the_resolution_its_density(tmp_path, rng, count, resolution):
    ground = ground_of(tmp_path, spread(rng, count), 2)
    assert ground.grid.resolution == resolution
    x, y = ground.grid.xy()
    known = ground.quality != MISSING
    np.testing.assert_allclose(ground.heights[known], hill(x, y)[known], atol=0.35)
    assert known.mean() > 0.85


def test_a_cell_with_a_return_is_measured_and_one_between_interpolated(tmp_path, rng):
    points = spread(rng, 1600)
    ground = ground_of(tmp_path, points, 2, resolution=0.5)
    row, col, inside = ground.grid.cells(points[:, 0], points[:, 1])
    assert inside.all()
    assert np.isin(ground.quality[row, col], (MEASURED, MISSING)).mean() > 0.97
    assert (ground.quality == INTERPOLATED).sum() > 5000


def test_nothing_is_known_deep_inside_a_gap_or_outside_the_returns(tmp_path, rng):
    points = spread(rng)
    points = points[np.hypot(points[:, 0] - 5.0, points[:, 1]) > 8.0]
    points = points[np.hypot(points[:, 0] + 15.0, points[:, 1]) > 2.0]
    ground = ground_of(tmp_path, points, 2, resolution=0.5)
    x, y = ground.grid.xy()
    from_middle = np.hypot(x - 5.0, y)
    assert (ground.quality[from_middle < 4.0] == MISSING).all()
    assert (ground.quality[np.hypot(x + 15.0, y) < 1.5] == INTERPOLATED).all()
    assert np.isfinite(ground.heights).all() and (ground.surface[from_middle < 4.0] != WATER_INDEX).all()
    beyond = ground_of(tmp_path, points, 2, resolution=0.5, crop=(28.0, 0.0, 20.0))
    assert (beyond.quality[:, -8:] == MISSING).all()


def test_water_returns_become_level_water(tmp_path, rng):
    points = spread(rng)
    pond = np.hypot(points[:, 0], points[:, 1]) < 10.0
    points[pond, 2] = 97.0 + rng.normal(0.0, 0.03, pond.sum())
    ground = ground_of(tmp_path, points, np.where(pond, 9, 2), resolution=0.5)
    x, y = ground.grid.xy()
    from_middle = np.hypot(x, y)
    assert (ground.surface[from_middle < 9.0] == WATER_INDEX).all()
    assert (ground.surface[from_middle > 11.0] != WATER_INDEX).all()
    level = ground.heights[from_middle < 9.0]
    assert np.ptp(level) == 0.0 and level[0] == pytest.approx(97.0, abs=0.02)


def test_a_river_keeps_its_fall(tmp_path, rng):
    points = spread(rng)
    river = np.abs(points[:, 1]) < 6.0
    points[river, 2] = 95.0 + 0.05 * points[river, 0]
    ground = ground_of(tmp_path, points, np.where(river, 9, 2), resolution=0.5)
    row = ground.grid.rows // 2
    assert ground.heights[row, -5] - ground.heights[row, 5] == pytest.approx(2.75, abs=0.2)


def test_a_steep_face_is_rock(tmp_path, rng):
    points = spread(rng)
    points[:, 2] += 8.0 * np.clip(points[:, 0] / 3.0, 0.0, 1.0)
    ground = ground_of(tmp_path, points, 2, resolution=0.5)
    x, _ = ground.grid.xy()
    rock = ground.surface == SURFACES.index(Surface.ROCK)
    assert rock[(x > 0.8) & (x < 2.2)].mean() > 0.9 and not rock[np.abs(x) > 6.0].any()


def test_a_survey_without_ground_class_is_refused(tmp_path, rng):
    with pytest.raises(ScenarioError, match="0 returns of class 2"):
        ground_of(tmp_path, spread(rng), 1)


def test_returns_on_one_line_are_refused(tmp_path):
    line = np.column_stack([np.linspace(-30, 30, 50), np.zeros(50), np.full(50, 100.0)])
    with pytest.raises(ScenarioError):
        ground_of(tmp_path, line, 2)
