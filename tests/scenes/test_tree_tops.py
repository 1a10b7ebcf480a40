import math

import numpy as np
import pytest
from surveys import crown_points, ground_points, hill, write_las

from scenes.catalogue import CoverKind
from scenes.lidar_survey import ground_from_points
from scenes.point_cloud import read_points
from scenes.tree_tops import canopy_heights, crown_window, standing_objects

TREES = [(-15.0, -12.0, 14.0, 2.5), (-5.0, -12.0, 8.0, 1.8), (12.0, 10.0, 20.0, 3.5), (3.0, 14.0, 5.0, 1.4)]


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def objects_of(tmp_path, ground, *layers):
    points = np.concatenate([ground, *(layer for layer, _ in layers)])
    classes = np.concatenate([np.full(len(ground), 2), *(np.full(len(p), c) for p, c in layers)])
    cloud = read_points(write_las(tmp_path / "a.laz", points, classes), None)
    return standing_objects(cloud, ground_from_points(cloud, 0.5))


def nearest(objects, x, y):
    return min(objects, key=lambda o: np.hypot(o.x - x, o.y - y))


@pytest.mark.parametrize("label", [1, 3, 4, 5])
def test_each_tree_is_found_with_its_place_height_and_crown(tmp_path, rng, label):
    crowns = np.concatenate([crown_points(rng, *tree) for tree in TREES])
    found = objects_of(tmp_path, ground_points(rng, 60.0, 4000), (crowns, label))
    assert [o.kind for o in found] == [CoverKind.TREE] * len(TREES)
    assert [o.id for o in found] == [1, 2, 3, 4] and found[0].height >= found[-1].height
    for x, y, height, radius in TREES:
        tree = nearest(found, x, y)
        assert np.hypot(tree.x - x, tree.y - y) < 0.5
        assert tree.height == pytest.approx(height, abs=0.3)
        assert 0.5 * tree.length == pytest.approx(radius, abs=0.4)


def test_neighbours_whose_crowns_touch_stay_two(tmp_path, rng):
    crowns = np.concatenate([crown_points(rng, 0.0, 0.0, 10.0, 2.0), crown_points(rng, 4.0, 0.0, 9.0, 2.0)])
    found = objects_of(tmp_path, ground_points(rng, 60.0, 4000), (crowns, 5))
    assert sorted(round(o.x) for o in found) == [0, 4]


def test_unclassified_returns_are_no_plants_where_plants_are_classified(tmp_path, rng):
    tree, pole = crown_points(rng, -8.0, 0.0, 10.0, 2.0), crown_points(rng, 8.0, 0.0, 10.0, 2.0)
    found = objects_of(tmp_path, ground_points(rng, 60.0, 4000), (tree, 5), (pole, 1))
    assert len(found) == 1 and found[0].x == pytest.approx(-8.0, abs=0.5)


def test_low_plants_are_bushes_and_lower_ones_nothing(tmp_path, rng):
    bush, tuft = crown_points(rng, 5.0, 5.0, 1.5, 1.0, 60), crown_points(rng, -5.0, 5.0, 0.4, 1.0, 60)
    found = objects_of(tmp_path, ground_points(rng, 60.0, 4000), (bush, 3), (tuft, 3))
    assert {o.kind for o in found} == {CoverKind.BUSH}
    assert max(o.height for o in found) == pytest.approx(1.5, abs=0.2)
    assert all(np.hypot(o.x - 5.0, o.y - 5.0) < 1.5 for o in found)


def test_plants_over_missing_ground_are_left_out(tmp_path, rng):
    ground = ground_points(rng, 60.0, 4000)
    ground = ground[np.hypot(ground[:, 0], ground[:, 1]) > 12.0]
    found = objects_of(tmp_path, ground, (crown_points(rng, 0.0, 0.0, 10.0, 2.0), 5))
    assert found == []


def test_building_returns_become_an_upright_box(tmp_path, rng):
    along, across = rng.uniform(-5.0, 5.0, 1500), rng.uniform(-3.0, 3.0, 1500)
    turn = np.radians(30.0)
    x = 4.0 + along * np.cos(turn) - across * np.sin(turn)
    y = -3.0 + along * np.sin(turn) + across * np.cos(turn)
    roof = np.column_stack([x, y, hill(x, y) + 4.0])
    (house,) = objects_of(tmp_path, ground_points(rng, 60.0, 4000), (roof, 6))
    assert house.kind is CoverKind.BUILDING
    assert (house.x, house.y) == (pytest.approx(4.0, abs=0.2), pytest.approx(-3.0, abs=0.2))
    assert sorted((house.length, house.width)) == pytest.approx([6.0, 10.0], abs=0.3)
    longer = house.yaw if house.length > house.width else house.yaw + 90.0
    assert min((longer - 30.0) % 180.0, (30.0 - longer) % 180.0) < 2.0
    assert house.height == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize(("length", "width"), [(6.0, 6.0), (12.0, 10.0), (40.0, 25.0)])
@pytest.mark.parametrize("a_square_metre", [2, 6])
def test_a_roof_with_no_ground_returns_beneath_it_is_one_building(
    tmp_path, rng, length, width, a_square_metre
):
    ground = ground_points(rng, 80.0, 6400 * a_square_metre)
    ground = ground[(abs(ground[:, 0]) > 0.5 * length) | (abs(ground[:, 1]) > 0.5 * width)]
    count = round(length * width * a_square_metre)
    x, y = rng.uniform(-0.5, 0.5, (2, count)) * [[length], [width]]
    roof = np.column_stack([x, y, np.full(count, hill(0.0, 0.0) + 7.0)])
    (house,) = objects_of(tmp_path, ground, (roof, 6))
    assert sorted((house.length, house.width)) == pytest.approx([width, length], abs=0.8)
    assert math.hypot(house.x, house.y) < 0.5
    assert house.height == pytest.approx(7.0, abs=1.5)


def test_a_roof_far_from_all_ground_is_left_out(tmp_path, rng):
    ground = ground_points(rng, 80.0, 8000)
    ground = ground[np.hypot(ground[:, 0], ground[:, 1]) > 30.0]
    x, y = rng.uniform(-5.0, 5.0, (2, 600))
    assert objects_of(tmp_path, ground, (np.column_stack([x, y, hill(x, y) + 5.0]), 6)) == []


def test_taller_trees_keep_their_neighbours_farther_away():
    windows = crown_window(np.array([2.0, 10.0, 30.0]))
    assert windows == pytest.approx([1.275, 1.708, 5.312], abs=1e-3)


def test_the_canopy_keeps_the_highest_return_of_a_cell():
    canopy = canopy_heights(np.array([0.1, -0.1, 5.0]), np.zeros(3), np.array([3.0, 4.0, 9.0]), 1.0)
    assert sorted(canopy.heights[canopy.heights > 0.0]) == [4.0, 9.0]
    assert canopy.x[canopy.heights == 4.0] == -0.1
