"""How far the Husky rolls on: what the network may say, what it learns, and that the driver heeds it."""

import json
import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from maps import drive, grid_map, percept
from scenes_to_hide_in import flat

from planner import stopping_lessons
from planner.checkpoint import PolicyError
from planner.cost_map import CostConfig, ground_near
from planner.driver import Driver
from planner.exposure_network import ExposureNetwork, save_network
from planner.methods import POLICIES, Learned, make_method
from planner.scene_samples import Lessons
from planner.stopping import LearnedStopping, StoppingNetwork, features, load_stopping, save_stopping
from scenes.physics import World
from scenes.pose import Pose, Twist
from scenes.scenario import Start

SHIPPED = POLICIES / "covernav.safetensors"
TILTS, SPEEDS, RATES = st.floats(-0.38, 0.38), st.floats(0.1, 1.0), st.floats(-1.0, 1.0)


@given(SPEEDS, TILTS, TILTS, RATES)
def test_untaught_it_knows_the_drivers_own_braking(v, roll, pitch, w):
    ways = LearnedStopping(StoppingNetwork()).ways(Pose(0.0, 0.0, 0.0, roll, pitch), Twist(v, w))
    np.testing.assert_allclose(ways, v * v, rtol=1e-5)


@given(SPEEDS, TILTS, TILTS, RATES, st.integers(0, 99))
def test_left_is_as_right_and_the_worst_never_the_shorter(v, roll, pitch, w, seed):
    torch.manual_seed(seed)
    network = StoppingNetwork()
    torch.nn.init.normal_(network.last.weight)
    taught = LearnedStopping(network)
    ways = taught.ways(Pose(0.0, 0.0, 0.0, roll, pitch), Twist(v, w))
    np.testing.assert_array_equal(ways, taught.ways(Pose(0.0, 0.0, 0.0, -roll, pitch), Twist(v, -w)))
    assert 0.0 <= ways[0] <= ways[1]


def test_a_nose_that_points_up_is_a_rise():
    speed, rise, bank, rate = features(Pose(0.0, 0.0, 0.0, 0.1, -0.2), Twist(0.5, 0.3))
    assert (speed, rate) == pytest.approx((0.5, 0.3))
    assert rise == pytest.approx(math.sin(0.2)) and bank == pytest.approx(math.sin(0.1) * math.cos(0.2))


def test_weights_come_back_and_others_are_refused(tmp_path):
    torch.manual_seed(3)
    network = StoppingNetwork()
    torch.nn.init.normal_(network.last.weight)
    named = save_stopping(tmp_path / "w.safetensors", network)
    taught, again = load_stopping(tmp_path / "w.safetensors")
    pose, twist = Pose(0.0, 0.0, 0.0, 0.1, 0.1), Twist(0.7, 0.2)
    assert again == named
    np.testing.assert_array_equal(taught.ways(pose, twist), LearnedStopping(network).ways(pose, twist))
    save_network(tmp_path / "other.safetensors", ExposureNetwork((8, 8, 8)))
    with pytest.raises(PolicyError, match="exposure_unet"):
        load_stopping(tmp_path / "other.safetensors")


def test_stops_are_taken_in_physics_and_the_same_again(monkeypatch):
    monkeypatch.setattr(stopping_lessons, "STOPS", 4)
    one, two = (stopping_lessons.stops(5000) for _ in range(2))
    assert 1 <= len(one["ways"]) <= 4 and len(one["features"]) == len(one["ways"])
    assert ((one["ways"] >= 0.0) & (one["ways"] < 0.6)).all()
    assert all(np.array_equal(one[name], two[name]) for name in one)


def test_it_learns_the_quantiles_of_what_stops_took(tmp_path):
    rng = np.random.default_rng(0)
    for seed in range(2):
        speed = rng.uniform(0.2, 1.0, 400).astype(np.float32)
        told = np.stack([speed, *np.zeros((3, 400), np.float32)], 1)
        ways = speed**2 * rng.uniform(0.1, 0.3, 400).astype(np.float32)
        np.savez(tmp_path / f"{seed}.npz", features=told, ways=ways)
    lessons = Lessons(scenes=1, held_out=1, seed=0, epochs=150)
    scores = [now for now, better in stopping_lessons.learn(tmp_path, lessons) if better]
    usual, worst = load_stopping(tmp_path / "covernav.safetensors")[0].ways(
        Pose(0.0, 0.0, 0.0), Twist(0.8, 0.0)
    )
    assert usual == pytest.approx(0.64 * 0.2, abs=0.01) and worst == pytest.approx(0.64 * 0.29, abs=0.015)
    assert scores[-1].covered == pytest.approx((0.5, 0.95), abs=0.06)
    assert scores[-1].pinball < 0.1 * scores[-1].gentle_pinball
    assert json.loads((tmp_path / "covernav.json").read_text())["stops"] == 400


@pytest.mark.parametrize("speed", [0.3, 0.6, 1.0])
def test_the_shipped_weights_foresee_a_stop_on_level_ground(speed):
    with World(flat(), start=Start(x=-5.0, y=0.0)) as world:
        for _ in range(12):
            world.step(Twist(speed, 0.0), 0.1)
        begin, twist = world.pose, world.twist
        for _ in range(10):
            world.step(Twist(), 0.1)
        rolled = world.pose.x - begin.x
    usual, worst = load_stopping(SHIPPED)[0].ways(begin, twist)
    assert usual == pytest.approx(rolled, abs=0.02) and worst < usual + 0.03


def test_the_shipped_weights_are_small_and_have_a_card():
    assert SHIPPED.stat().st_size < 5_000_000
    card = json.loads(SHIPPED.with_suffix(".json").read_text())
    assert {"command", "seed", "data", "steps", "figures", "weaknesses", "sha256"} <= set(card)
    method = make_method("covernav")
    assert isinstance(method, Learned) and method.policy.sha256 == card["sha256"]
    assert not isinstance(make_method("covernav[no_learning]"), Learned)


class AtOnce:
    """A robot that stops within so many metres."""

    def __init__(self, *ways: float):
        self._ways = np.array(ways)

    def ways(self, pose, twist):
        return self._ways


def arrives(driver, goal=(6.0, 0.0)):
    def decide(now):
        return driver.drive(now, now.goal, ground_near(now.grid, now.pose.x, now.pose.y, 3.2, CostConfig()))

    return drive(decide, grid_map(), Pose(0.0, 0.0, 0.0), goal)


def test_the_driver_that_knows_how_it_stops_arrives_sooner():
    gentle, knowing = arrives(Driver()), arrives(Driver(stopping=AtOnce(0.0, 0.05)))
    assert len(knowing) <= len(gentle) - 3
    now, driven = knowing[-1]
    assert now.goal_distance < 0.3 and driven.command == Twist()


def test_it_does_not_stop_where_it_would_come_to_rest_too_far_from_the_goal():
    driver = Driver(stopping=AtOnce(0.3, 0.9))  # nobody knows whether here or there
    assert not any(driven.note == "stopping at the goal" for _, driven in arrives(driver))
    passing = percept(grid_map(), Pose(0.0, 0.0, 0.0), (0.3, 0.5), Twist(1.0, 0.0))
    far = Driver(stopping=AtOnce(0.3, 0.3)).drive(
        passing, passing.goal, ground_near(passing.grid, 0.0, 0.0, 3.2, CostConfig())
    )
    assert far.note != "stopping at the goal"
