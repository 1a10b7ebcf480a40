"""The registry of methods, the plain baseline, and the least-cost one."""

import hashlib
import json
import pickle

import numpy as np
import pytest
from maps import drive, grid_map, percept

from planner.frames import Status
from planner.methods import DEFAULT_METHOD, METHODS, POLICIES, VARIANTS, Briefed, make_method
from planner.methods.least_cost import LeastCost, LeastCostConfig
from scenes.pose import Pose

ORIGIN = Pose(0.0, 0.0, 0.0)
ROUTES = {"route", "route_balanced", "route_shortest", "route_known", "route_wary"}
SELF_RELIANT = [name for name in METHODS if name not in ROUTES]


def trap(x, y):
    """A cup that is open toward the start and lies on the way."""
    back = (np.abs(x - 3.0) < 0.2) & (np.abs(y) < 2.0)
    sides = (np.abs(np.abs(y) - 2.0) < 0.2) & (x > 0.5) & (x < 3.2)
    return back | sides


def test_methods_are_found_by_name_and_say_what_they_are():
    assert {"dwa", "least_cost", "covernav"} | ROUTES <= set(METHODS)
    assert all(isinstance(make_method(name), Briefed) for name in ROUTES)
    assert DEFAULT_METHOD in METHODS
    for name, entry in METHODS.items():
        assert make_method(name, seed=3).name == name
        assert entry.description.endswith(".")


def test_an_unknown_name_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match="'teleport'.*" + ", ".join(METHODS)):
        make_method("teleport")


@pytest.mark.parametrize("name", SELF_RELIANT)
def test_every_method_reaches_a_goal_on_open_ground(name):
    log = drive(make_method(name).decide, grid_map(), ORIGIN)
    assert len(log) < 150
    now, decision = log[-1]
    assert now.goal_distance < 0.35 and decision.failure is None
    assert all(decision.waypoint is not None for _, decision in log)
    assert log[0][1].arcs is not None


@pytest.mark.parametrize("name", SELF_RELIANT)
def test_every_method_can_be_pickled_in_the_middle_of_a_drive(name):
    method = make_method(name)
    grid = grid_map(blocked=trap)
    log = drive(method.decide, grid, ORIGIN, ticks=12)
    twin = pickle.loads(pickle.dumps(method))
    now = log[-1][0]
    assert twin.decide(now).command == method.decide(now).command


def test_least_cost_does_not_run_into_a_dead_end():
    log = drive(LeastCost().decide, grid_map(blocked=trap), ORIGIN)
    now, decision = log[-1]
    assert now.goal_distance < 0.35 and decision.failure is None
    inside = [0.9 < step.pose.x < 2.8 and abs(step.pose.y) < 1.8 for step, _ in log]
    assert not any(inside)


def test_least_cost_goes_around_a_steep_bank_that_could_be_driven():
    def bank(x, y):
        return 0.9 * np.exp(-(((x - 3.0) / 1.5) ** 2)) * (np.abs(y) < 1.5)

    log = drive(LeastCost().decide, grid_map(bank), ORIGIN)
    assert log[-1][0].goal_distance < 0.35
    assert max(abs(now.pose.y) for now, _ in log) > 1.2


def test_least_cost_shows_its_route_and_cost_map():
    decision = LeastCost().decide(percept(grid_map(), ORIGIN))
    assert np.hypot(*(decision.route[0] - (0.0, 0.0))) < 0.3
    assert np.hypot(*(decision.route[-1] - (6.0, 0.0))) < 0.3
    assert decision.cost.cost.shape == (81, 81)


def test_the_waypoint_never_lies_behind_a_corner():
    grid = grid_map(blocked=lambda x, y: (x > 0.8) & (x < 1.4) & (y > -1.0))
    for now, decision in drive(LeastCost().decide, grid, ORIGIN):
        line = np.linspace((now.pose.x, now.pose.y), decision.waypoint, 40)
        assert not ((line[:, 0] > 0.8) & (line[:, 0] < 1.4) & (line[:, 1] > -1.0)).any()


def test_between_two_equal_ways_it_keeps_to_the_one_it_took():
    grid = grid_map(blocked=lambda x, y: (np.abs(x - 3.0) < 0.3) & (np.abs(y) < 1.5))
    log = drive(LeastCost().decide, grid, ORIGIN)
    sides = [np.sign(decision.route[np.argmin(np.abs(decision.route[:, 0] - 3.0)), 1])
             for now, decision in log if now.pose.x < 2.0]  # fmt: skip
    assert len(set(sides)) == 1


@pytest.mark.parametrize("half_length", [0.6, 1.2])
def test_least_cost_passes_a_passage_a_hand_wider_than_the_robot(half_length):
    grid = grid_map(blocked=lambda x, y: (np.abs(x - 2.0) < half_length) & (np.abs(y) > 0.55))
    log = drive(make_method("least_cost").decide, grid, Pose(0.0, 0.6, 0.0))
    assert log[-1][0].goal_distance < 0.35
    assert not any("dead end" in decided.note for _, decided in log)


def wavering(gap):
    """A wall across the way with a passage half as wide as `gap` metres in the middle, another far off."""
    return grid_map(
        blocked=lambda x, y: (np.abs(x - 2.0) < 0.15) & (np.abs(y) > gap) & ((y < 5.0) | (y > 6.5))
    )


@pytest.mark.parametrize("name", ["least_cost", "covernav"])
def test_a_passage_that_the_map_narrows_by_a_cell_is_still_passed(name):
    wide, narrow = (
        percept(wavering(gap), Pose(0.0, 0.0, 0.0), time_s=time_s) for gap, time_s in ((0.7, 0.0), (0.3, 1.0))
    )
    direct = make_method(name)
    for seen in (wide, narrow):
        route = direct.decide(seen).route
        assert route is not None and np.abs(route[:, 1]).max() < 1.0
    # Who has not begun that way does not take it.
    route = make_method(name).decide(narrow).route
    assert route is not None and route[:, 1].max() > 4.5


def test_a_goal_that_is_walled_in_is_unreachable_after_a_while():
    grid = grid_map(blocked=lambda x, y: np.abs(np.hypot(x - 5.0, y) - 1.5) < 0.3)
    log = drive(LeastCost(LeastCostConfig(patience=1.0)).decide, grid, ORIGIN, goal=(5.0, 0.0))
    assert log[0][1].failure is None and "no route" in log[0][1].note
    assert log[-1][1].failure is Status.UNREACHABLE
    assert log[-1][0].time_s == pytest.approx(1.1, abs=0.15)


def test_a_goal_beside_an_obstacle_is_still_driven_to():
    grid = grid_map(blocked=lambda x, y: (x > 5.5) & (x < 6.5) & (y > 0.4) & (y < 1.0))
    log = drive(LeastCost().decide, grid, ORIGIN, goal=(6.0, -0.15))
    assert log[-1][0].goal_distance < 0.35


def test_unknown_ground_is_crossed_when_there_is_no_other_way():
    grid = grid_map(unknown=lambda x, y: (x > 2.0) & (x < 3.0))
    log = drive(LeastCost().decide, grid, ORIGIN)
    assert log[-1][0].goal_distance < 0.35


def test_reset_forgets_the_route():
    method = LeastCost()
    before = method.decide(percept(grid_map(), ORIGIN))
    method.reset()
    after = method.decide(percept(grid_map(), ORIGIN, goal=(0.0, 6.0), time_s=0.1))
    assert np.hypot(*(after.route[-1] - (0.0, 6.0))) < 0.3
    assert before.route[-1][0] > 5.0


@pytest.mark.parametrize("name", ["least_cost", "covernav"])
def test_a_gap_that_the_driver_cannot_pass_is_left_for_another(name, monkeypatch):
    gaps = grid_map(blocked=lambda x, y: (abs(x - 1.5) < 0.15) & (abs(y - 0.4) > 0.9) & (abs(y + 4.0) > 0.9))
    method = make_method(name)
    seen = percept(gaps, Pose(0.6, 0.4, 0.0), goal=(4.0, 0.4))

    def crossing() -> float:
        x, y = method.decide(seen).route.T
        return float(y[np.argmin(np.abs(x - 1.5))])

    assert crossing() == pytest.approx(0.4, abs=0.4)
    monkeypatch.setattr(type(method.driver), "recoveries", 2)
    assert crossing() == pytest.approx(-4.0, abs=0.6)
    method.reset()
    monkeypatch.setattr(type(method.driver), "recoveries", 0)
    assert crossing() == pytest.approx(0.4, abs=0.4)


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_are_the_methods_they_are_variants_of(name):
    assert make_method(name).name == name.partition("[")[0]
    assert name not in METHODS and VARIANTS[name].description.endswith(".")


@pytest.mark.parametrize("weights", sorted(POLICIES.glob("*.safetensors")), ids=lambda path: path.stem)
def test_every_policy_is_small_and_has_a_card_that_is_its_own(weights):
    card = json.loads(weights.with_suffix(".json").read_text("utf-8"))
    assert {"command", "seed", "data", "steps", "figures", "weaknesses", "sha256"} <= set(card)
    assert card["sha256"] == hashlib.sha256(weights.read_bytes()).hexdigest()
    assert card["command"].startswith("covernav train") and weights.stat().st_size <= 5_000_000
