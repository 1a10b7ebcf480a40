"""The shipped scenarios."""

import math

import numpy as np
import pytest

from scenes.library import load_shipped, shipped
from scenes.scenario import Family, ScenarioError
from scenes.traversability import reachable

NAMES = tuple(shipped())


def test_there_are_three_or_more_of_each_terrain():
    families = [load_shipped(name).terrain.source.family for name in NAMES]
    assert len(NAMES) >= 12 and list(NAMES) == sorted(NAMES)
    assert all(families.count(family) >= 3 for family in Family)


@pytest.mark.parametrize("name", NAMES)
def test_each_is_described_small_and_written_as_it_would_be_saved(name):
    scenario, path = load_shipped(name), shipped()[name]
    assert scenario.name == name and scenario.description.endswith(".")
    assert path.stat().st_size < 300 * 1024
    assert path.read_text("utf-8") == scenario.to_json()


@pytest.mark.parametrize("name", NAMES)
def test_each_has_a_reachable_goal_ten_to_thirty_metres_away_and_an_observer(name):
    scenario = load_shipped(name)
    start, goal = (scenario.start.x, scenario.start.y), (scenario.goal.x, scenario.goal.y)
    assert 10.0 <= math.dist(start, goal) <= 30.0
    assert reachable(scenario.terrain.heightmap(), scenario.cover, start, goal, clearance=0.6)
    assert scenario.observers


@pytest.mark.parametrize("name", NAMES)
def test_nobody_walks_through_things(name):
    scenario = load_shipped(name)
    for walker in (*scenario.observers, *scenario.obstacles):
        if walker.patrol is None:
            continue
        course = np.array([walker.pose_at(time_s)[:2] for time_s in np.arange(0.0, 120.0, 0.25)])
        assert min(thing.footprint.distance(course).min() for thing in scenario.cover) > 0.25


def test_some_observers_and_others_are_on_the_move():
    scenarios = [load_shipped(name) for name in NAMES]
    assert sum(any(o.patrol for o in scenario.observers) for scenario in scenarios) >= 3
    assert {o.kind.value for scenario in scenarios for o in scenario.obstacles} == {"person", "vehicle"}


def test_the_paper_s_figure():
    """A bush, a truck and a cottage in this order between start and goal, and one who watches."""
    scenario = load_shipped("bush-truck-cottage")
    start, goal = (np.array([p.x, p.y]) for p in (scenario.start, scenario.goal))
    along = (goal - start) / np.linalg.norm(goal - start)
    barring = [
        (float((np.array([thing.x, thing.y]) - start) @ along), thing.kind.value)
        for thing in scenario.cover
        if thing.footprint.distance(np.linspace(start, goal, 200)).min() < 0.0
    ]
    assert [kind for _, kind in sorted(barring)] == ["bush", "disabled_vehicle", "cottage"]
    assert len(scenario.observers) == 1


def test_an_unknown_name_is_answered_with_the_names_there_are():
    with pytest.raises(
        ScenarioError, match="no shipped scenario is called 'moon'; there are boulder-field, "
    ):
        load_shipped("moon")
