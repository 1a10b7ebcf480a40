"""Putting things on a map."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small import flat

from scenes.catalogue import CATALOGUE, CoverKind
from scenes.placement import Plot, distance_to_segment, draw, place_observers, within_half_turn
from scenes.scenario import CoverSpec
from scenes.terrain import Heightmap

ROUTE = ((-6.0, 0.0), (6.0, 0.0))


def thing(kind: str, x: float, y: float, **fields) -> CoverSpec:
    return CoverSpec.model_validate({"kind": kind, "x": x, "y": y} | fields)


def test_what_is_put_is_numbered_from_one():
    plot = Plot(10.0, ROUTE)
    assert plot.put(thing("bush", 0.0, 0.0)) and plot.put(thing("rock", 0.0, 5.0))
    assert [(cover.id, cover.kind.value) for cover in plot.cover] == [(1, "bush"), (2, "rock")]


@pytest.mark.parametrize(
    ("second", "fits"),
    [
        (thing("bush", 1.0, 0.0), False),
        (thing("bush", 2.0, 0.0), True),
        (thing("bush", -5.0, 0.0), False),
        (thing("bush", 6.0, 1.2), False),
        (thing("house", 5.0, 6.0), False),
        (thing("bush", 9.5, 9.5), False),
    ],
    ids=["touches", "free", "start needs room", "goal needs room", "over the edge", "at the edge"],
)
def test_things_keep_clear_of_each_other_the_ends_and_the_edge(second, fits):
    plot = Plot(10.0, ROUTE)
    plot.put(thing("bush", 0.0, 0.0))
    assert plot.put(second) is fits


def test_a_bush_may_grow_under_a_tree_but_crowns_do_not_overlap():
    plot = Plot(10.0, ROUTE)
    plot.put(thing("tree", 0.0, 4.0, length=4.0, width=4.0))
    assert plot.put(thing("bush", 1.5, 4.0))
    assert not plot.put(thing("tree", 0.0, 7.0, length=4.0, width=4.0))


def test_nothing_is_put_on_ground_that_is_kept_clear():
    plot, ground = Plot(10.0, ROUTE), flat(41, 0.5)
    plot.keep_clear(ground, ground.xy()[1] > 4.0)
    assert not plot.put(thing("bush", 0.0, 5.0)) and not plot.put(thing("fence", 0.0, 4.0, yaw=90.0))
    assert plot.put(thing("bush", 0.0, 2.5))


def test_rigid_things_need_level_ground_and_plants_do_not():
    plot, level = Plot(10.0, ROUTE), flat(41, 0.5)
    x, _ = level.xy()
    slope = Heightmap(0.25 * x, 0.5, level.surface, level.quality)
    plot.keep_clear(slope, np.zeros(slope.shape, bool))
    assert not plot.put(thing("disabled_vehicle", 0.0, 4.0))
    assert not plot.put(thing("fence", 0.0, 4.0, yaw=0.0))
    assert plot.put(thing("fence", 0.0, 4.0, yaw=90.0)) and plot.put(thing("bush", 0.0, -4.0))


@given(st.sampled_from(CoverKind), st.integers(0, 1000))
def test_drawn_sizes_lie_within_the_class(kind, seed):
    drawn, entry = draw(np.random.default_rng(seed), kind, 1.0, 2.0), CATALOGUE[kind]
    for side in ("length", "width", "height"):
        assert getattr(entry, side).low <= getattr(drawn, side) <= getattr(entry, side).high
    assert drawn == draw(np.random.default_rng(seed), kind, 1.0, 2.0)


@given(st.floats(-1e4, 1e4))
def test_directions_are_written_within_half_a_turn(degrees):
    written = within_half_turn(degrees)
    assert -180.0 <= written <= 180.0
    turns = (written - degrees) / 360.0
    assert abs(turns - round(turns)) < 0.06 / 360.0


@pytest.mark.parametrize(("point", "distance"), [((0, 3), 3.0), ((8, 0), 2.0), ((-9, -4), 5.0)])
def test_distance_to_a_segment(point, distance):
    assert distance_to_segment(np.array([point], float), ROUTE)[0] == pytest.approx(distance)


@given(count=st.integers(0, 6), seed=st.integers(0, 100))
@settings(max_examples=20)
def test_observers_stand_free_off_the_route_and_face_it(count, seed):
    cover = [thing("house", 0.0, 6.0), thing("bush", 4.0, -4.0)]
    watchers = place_observers(np.random.default_rng(seed), flat(41, 0.5), cover, ROUTE, count)
    assert [watcher.id for watcher in watchers] == list(range(1, count + 1))
    for watcher in watchers:
        at = np.array([(watcher.x, watcher.y)])
        assert distance_to_segment(at, ROUTE)[0] > 2.4
        assert all(other.footprint.distance(at)[0] > 0.7 for other in cover)
        bearing = math.degrees(math.atan2(-watcher.y, -watcher.x))
        assert abs(within_half_turn(bearing - watcher.yaw)) <= 20.2
        assert 40.0 <= watcher.range <= 60.0


def test_observers_prefer_high_ground():
    level = flat(41, 0.5)
    x, y = level.xy()
    hill = Heightmap(
        4.0 * np.exp(-((x - 4.0) ** 2 + (y - 6.0) ** 2) / 8.0), 0.5, level.surface, level.quality
    )
    heights = [
        float(hill.height_at(watcher.x, watcher.y))
        for seed in range(10)
        for watcher in place_observers(np.random.default_rng(seed), hill, [], ROUTE, 1)
    ]
    assert np.median(heights) > 2.0
