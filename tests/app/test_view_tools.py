"""Clicks: what lies under the pointer, and what each tool makes of it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meadows import meadow_scene
from served import silent_studio

from app.changes import Kind, Selection, StudioError
from app.view import tools
from app.view.picking import Pick, Picker
from app.view.tools import Armed, Tool
from scenes.catalogue import CoverKind
from scenes.scenario import CoverObject, ObstacleKind, ObstacleSpec

EYE = np.array([-9.0, -9.0, 7.0])
OBSERVER, TREE = Selection(Kind.OBSERVER, 1), Selection(Kind.COVER, 1)
MEADOW = meadow_scene()


@pytest.fixture
def studio(tmp_path):
    return silent_studio(tmp_path, MEADOW)


def pick(target, scenario=MEADOW) -> Pick:
    target = np.asarray(target, float)
    return Picker().pick(EYE, target - EYE, scenario, scenario.terrain.heightmap(), None)


@given(st.floats(-9.5, 9.5), st.floats(-9.5, 3.0))
def test_a_ray_at_the_ground_finds_the_point_under_the_pointer(x, y):
    found = pick((x, y, 0.0)).point
    assert found is not None
    assert math.dist(found, (x, y)) < 0.01


def test_the_ground_of_a_hill_is_found_where_it_is(tmp_path):
    y, x = np.mgrid[0:41, 0:41]
    heights = 0.8 * np.sin(0.2 * x) * np.cos(0.15 * y)
    terrain = MEADOW.terrain.model_copy(update={"heights": heights})
    hill = MEADOW.model_copy(update={"terrain": terrain, "cover": ()})
    target = np.array([1.3, -2.2, float(hill.terrain.heightmap().height_at(1.3, -2.2))])
    found = pick(target, hill).point
    assert found is not None and math.dist(found, target[:2]) < 0.01


@pytest.mark.parametrize(
    ("target", "thing"),
    [
        ((0.0, 5.0, 4.0), TREE),
        ((0.0, 8.0, 1.0), OBSERVER),
        ((0.2, 8.1, 0.9), OBSERVER),
        ((3.0, 0.0, 0.8), Selection(Kind.GOAL)),
        ((-3.0, 0.0, 0.1), Selection(Kind.START)),
        ((-6.0, 5.0, 0.0), None),
    ],
)
def test_what_stands_under_the_pointer_is_meant(target, thing):
    assert pick(target).thing == thing


def test_a_small_figure_is_hit_a_little_beside_it():
    """From 20 m a person is a few pixels wide."""
    assert pick((0.55, 8.0, 0.9)).thing == OBSERVER
    assert pick((2.5, 8.0, 0.0)).thing is None


def test_the_sky_is_no_place():
    assert pick(EYE + np.ones(3)) == Pick(None, None)


@pytest.mark.parametrize(
    "ray", [((math.nan, 0, 0), (0, 0, -1)), ((0, 0, 5), (0, 0, 0)), ((0, 0, 5), (0, math.inf, 0))]
)
def test_a_ray_that_no_mouse_makes_is_refused(ray):
    with pytest.raises(ValueError, match="finite"):
        Picker().pick(*ray, MEADOW, MEADOW.terrain.heightmap(), None)


def test_nothing_armed_selects_and_an_empty_place_deselects(studio):
    tools.click(studio, Armed(), Pick((0.0, 5.0), TREE))
    assert studio.selection == TREE
    tools.click(studio, Armed(), Pick((-6.0, 6.0), None))
    assert studio.selection is None and not studio.can_undo


@pytest.mark.parametrize(
    ("tool", "place"),
    [
        (Tool.GOAL, lambda s: (s.goal.x, s.goal.y)),
        (Tool.START, lambda s: (s.start.x, s.start.y)),
        (Tool.OBSERVER, lambda s: (s.observers[-1].x, s.observers[-1].y)),
        (Tool.COVER, lambda s: (s.cover[-1].x, s.cover[-1].y)),
        (Tool.OBSTACLE, lambda s: (s.obstacles[-1].x, s.obstacles[-1].y)),
    ],
)
def test_a_tool_places_its_thing_where_the_click_was(studio, tool, place):
    tools.click(studio, Armed(tool), Pick((1.0, -4.0), None))
    assert place(studio.scenario) == (1.0, -4.0)
    studio.undo()
    assert studio.scenario == MEADOW


def test_the_chosen_kinds_are_placed_and_selected(studio):
    armed = Armed(Tool.COVER, cover=CoverKind.FENCE, obstacle=ObstacleKind.VEHICLE)
    tools.click(studio, armed, Pick((1.0, -5.0), None))
    assert studio.find(studio.selection).kind is CoverKind.FENCE
    armed.tool = Tool.OBSTACLE
    tools.click(studio, armed, Pick((-6.0, -6.0), None))
    assert studio.find(studio.selection).kind is ObstacleKind.VEHICLE


def test_a_new_observer_looks_toward_the_drive(studio):
    tools.click(studio, Armed(Tool.OBSERVER), Pick((0.0, -8.0), None))
    assert studio.scenario.observers[-1].yaw == pytest.approx(90.0)


def test_patrol_points_follow_the_selected_walker(studio):
    armed = Armed(Tool.PATROL)
    with pytest.raises(StudioError, match="click an observer"):
        tools.click(studio, armed, Pick((1.0, 1.0), None))
    tools.click(studio, armed, Pick((0.0, 8.0), OBSERVER))
    for point in ((2.0, 8.0), (2.0, 6.0)):
        tools.click(studio, armed, Pick(point, None))
    waypoints = studio.scenario.observers[0].patrol.waypoints
    assert [(p.x, p.y) for p in waypoints] == [(2.0, 8.0), (2.0, 6.0)]


def test_move_and_rotate_act_on_what_was_clicked_first(studio):
    tools.click(studio, Armed(Tool.MOVE), Pick((0.0, 8.0), OBSERVER))
    tools.click(studio, Armed(Tool.MOVE), Pick((4.0, 7.0), None))
    tools.click(studio, Armed(Tool.ROTATE), Pick((4.0, 1.0), None))
    moved = studio.scenario.observers[0]
    assert (moved.x, moved.y, moved.yaw) == (4.0, 7.0, -90.0)


def test_the_start_turns_and_the_goal_does_not(studio):
    tools.turn(studio, Selection(Kind.START), 45.0)
    assert studio.scenario.start.yaw == 45.0
    with pytest.raises(StudioError, match="no facing"):
        tools.turn(studio, Selection(Kind.GOAL), 45.0)


def test_delete_takes_what_is_under_the_pointer(studio):
    tools.click(studio, Armed(Tool.DELETE), Pick((0.0, 5.0), TREE))
    assert studio.scenario.cover == ()
    with pytest.raises(StudioError, match="nothing here"):
        tools.click(studio, Armed(Tool.DELETE), Pick((0.0, 0.0), None))
    with pytest.raises(StudioError, match="cannot be deleted"):
        tools.click(studio, Armed(Tool.DELETE), Pick((3.0, 0.0), Selection(Kind.GOAL)))


@pytest.mark.parametrize(
    "tool", [t for t in Tool if t not in (Tool.MOVE, Tool.ROTATE, Tool.DELETE, Tool.PATROL)]
)
def test_a_click_beyond_the_map_is_refused_with_the_reason(studio, tool):
    with pytest.raises(StudioError, match="beyond the map"):
        tools.click(studio, Armed(tool), Pick(None, None))
    assert studio.scenario is MEADOW


def test_a_goal_on_a_roof_is_refused_because_it_is_inside_the_house(studio):
    house = CoverObject(id=2, kind="house", x=-5.0, y=5.0)
    studio.add_cover(house)
    under = pick((-5.0, 5.0, 3.0), studio.scenario)
    assert under.thing == Selection(Kind.COVER, 2)
    with pytest.raises(StudioError, match="goal is inside a house"):
        tools.click(studio, Armed(Tool.GOAL), under)


def test_every_kind_of_thing_can_be_moved(studio):
    studio.add_obstacle(ObstacleSpec(kind="person", x=5.0, y=-5.0))
    for kind in Kind:
        thing = Selection(kind, 0 if kind in (Kind.START, Kind.GOAL) else 1)
        tools.move(studio, thing, -7.0, -7.0 + 3 * list(Kind).index(kind), drag="one drag")
        found = studio.find(thing)
        assert (found.x, found.y) == (-7.0, -7.0 + 3 * list(Kind).index(kind))
    studio.undo()
    assert (studio.scenario.goal.x, studio.scenario.obstacles[0].x) == (3.0, 5.0)  # a drag is one entry
