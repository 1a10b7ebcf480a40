"""What is driven: the same missions for every method, and a result that says all that was asked."""

import json

import pytest
from drives import mission

from planner.evaluation import MissionSpec, drive, specs
from planner.frames import Perception
from planner.scene_recipe import rebuilt, recipe
from planner.suites import Knowledge, Suite, suite_mission
from planner.trajectory import Trajectory
from scenes.scenario import Family, ScenarioError


def test_every_method_gets_the_same_seeds():
    both = specs(["dwa", "least_cost"], [Family.LOW], 3, 5, Perception.LIDAR, 12.0)
    by_method = {name: [s.seed for s in both if s.method == name] for name in ("dwa", "least_cost")}
    assert by_method["dwa"] == by_method["least_cost"] == [5, 6, 7]


def test_a_result_of_old_answers_the_spec_that_it_answered_then():
    old = mission(3)
    assert MissionSpec.of(old) == MissionSpec(Family.NORMAL, "dwa", 3, Perception.LIDAR, 12.0)
    with pytest.raises(KeyError):
        MissionSpec.of({key: value for key, value in old.items() if key != "seed"})
    with pytest.raises(ValueError):
        MissionSpec.of(old | {"terrain": "moon"})


@pytest.fixture(scope="module")
def spec():
    return MissionSpec(Family.LOW, "dwa", 3, Perception.ORACLE, 4.0, Suite.RANDOM, Knowledge.UNKNOWN)


@pytest.fixture(scope="module")
def result(spec):
    return json.loads(json.dumps(drive(spec), allow_nan=False))


def test_a_result_answers_its_spec_and_repeats(spec, result):
    assert MissionSpec.of(result) == spec
    again = json.loads(json.dumps(drive(spec)))
    for document in (result, again):
        document.pop("planner_ms_p50", None), document.pop("planner_ms_p95", None)
    assert again == result


def test_a_result_says_where_the_drive_went(spec, result):
    way = Trajectory.of(result["trajectory"])
    start = suite_mission(*_place(spec)).scenario.start
    assert (way.x[0], way.y[0]) == pytest.approx((start.x, start.y), abs=0.006)
    assert way.duration_s == pytest.approx(result["execution_time_s"], abs=1e-3)


def test_a_result_holds_how_to_make_its_scene(spec, result):
    scenario = suite_mission(*_place(spec)).scenario
    assert rebuilt(result["scene"]).to_json() == scenario.to_json()
    assert all(not observer.known for observer in rebuilt(result["scene"]).observers)


def test_people_who_cross_the_way_are_part_of_the_scene():
    scenario = suite_mission(Suite.CROSSING, Family.NORMAL, 1, Knowledge.KNOWN, 12.0).scenario
    made = json.loads(json.dumps(recipe(scenario, 48.0, 12.0)))
    assert made["obstacles"] and rebuilt(made).to_json() == scenario.to_json()


def test_a_scene_that_grows_differently_now_is_refused(result):
    with pytest.raises(ScenarioError, match="does not grow any more"):
        rebuilt(result["scene"] | {"land": "0" * 16})


@pytest.mark.parametrize(
    "change", [{"family": "moon"}, {"seed": "x"}, {"observers": [{"id": 1}]}, {"size_m": 1e9}]
)
def test_a_damaged_recipe_is_refused(result, change):
    with pytest.raises(ScenarioError, match="recipe"):
        rebuilt(result["scene"] | change)


def _place(spec):
    return spec.suite, spec.terrain, spec.seed, spec.observers, spec.goal_distance
