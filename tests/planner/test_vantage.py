"""Watchers' places and the robot's hiding places."""

import math

import numpy as np
import pytest
from scenes_to_hide_in import START, behind_a_wall, eye, flat, wall

from planner.covert_route import CovertPlanner
from planner.no_route import NoRoute
from planner.vantage import HIDDEN, best_vantages, nearest_hiding_place

CROSS = [wall(1, 0.0, 0.0, 18.0), wall(2, 0.0, 6.0, 10.0, yaw=90.0)]


def test_one_watcher_sees_a_route_in_the_open():
    planner = CovertPlanner(flat(), [], [])
    (only,) = best_vantages(planner, np.array([[-5.0, 0.0], [5.0, 0.0]]), 3)
    assert only.seen == only.adds == 1.0


def test_round_walls_more_watchers_see_more_and_each_adds_less():
    planner = CovertPlanner(flat(), CROSS, [])
    around = np.array([[-5.0, 5.0], [-10.5, 0.0], [0.0, -5.0], [10.5, 0.0], [5.0, 5.0]])
    chosen = best_vantages(planner, around, 3)
    gains = [vantage.adds for vantage in chosen]
    assert len(chosen) >= 2 and gains == sorted(gains, reverse=True) and sum(gains) <= 1.0 + 1e-9
    assert chosen[0].seen < 1.0 and chosen[0].seen == chosen[0].adds


def test_the_first_place_is_the_best_of_those_tried():
    planner = CovertPlanner(flat(), CROSS, [])
    way = np.array([[-5.0, 5.0], [-10.5, 0.0], [0.0, -5.0]])
    first, *_ = best_vantages(planner, way, 2)
    assert all(first.seen >= other.seen for other in best_vantages(planner, way, 2))
    middle = way.mean(axis=0)
    bearing = math.atan2(middle[1] - first.y, middle[0] - first.x)
    assert abs(math.remainder(bearing - first.yaw, math.tau)) < 0.8


def test_nobody_stands_in_things_or_off_the_map():
    planner = CovertPlanner(flat(), CROSS, [])
    for place in best_vantages(planner, np.array([[-5.0, 5.0], [5.0, 5.0]]), 4):
        for thing in planner.cover:
            assert float(thing.footprint.distance(np.array([[place.x, place.y]]))[0]) >= 0.6


def test_at_least_one_watcher_is_asked_for():
    with pytest.raises(ValueError, match="at least one"):
        best_vantages(behind_a_wall(), np.array([[0.0, 0.0], [1.0, 0.0]]), 0)


def test_the_way_to_hide_leads_behind_the_wall():
    planner = behind_a_wall()
    route = nearest_hiding_place(planner, START)
    x, y = route.points[-1]
    row, col = planner.costs.cell(x, y)
    assert y < 0.0 and planner.exposure.fraction[:, row, col].max() <= HIDDEN
    assert route.length_m < 8.0


def test_who_is_hidden_stays_where_he_is():
    route = nearest_hiding_place(behind_a_wall(), (0.0, -3.0))
    assert route.length_m == pytest.approx(0.0, abs=1e-9)


def test_without_cover_there_is_nowhere_to_hide():
    with pytest.raises(NoRoute, match="hidden from every observer"):
        nearest_hiding_place(CovertPlanner(flat(), [], [eye(fov_vertical=180.0)]), START)
