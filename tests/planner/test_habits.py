"""How people and vehicles go on: what the network says and learns, and what the planner does with it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from maps import grid_map, percept

from planner import habit_lessons
from planner.checkpoint import PolicyError
from planner.exposure_network import ExposureNetwork, save_network
from planner.foresight import TrackLog
from planner.frames import TrackedObstacle
from planner.habits import (
    BINS,
    WAYS,
    HabitNetwork,
    LearnedHabits,
    angle_of,
    bin_of,
    load_habits,
    save_habits,
)
from planner.learning_errors import TrainingError, TrainingRefusal
from planner.methods import POLICIES, Learned, make_method
from planner.scene_samples import Lessons
from planner.walks import FEATURES
from scenes.patrol import patrol_pose
from scenes.pose import Pose, wrap_angle
from scenes.scenario import ObstacleKind

SHIPPED = POLICIES / "covernav.safetensors"


def tracked(waypoints, speed, seconds, kind=ObstacleKind.PERSON):
    """One who walks to and fro, and its track after some seconds."""
    log = TrackLog()
    for tick in range(round(10 * seconds) + 1):
        x, y, yaw = patrol_pose(waypoints, speed, False, 0.0, 0.1 * tick)
        walker = TrackedObstacle(1, kind, x, y, speed * math.cos(yaw), speed * math.sin(yaw), 0.25)
        log.see(0.1 * tick, [walker])
    return walker, log.tracks([walker])[1]


@given(st.floats(-math.pi, math.pi))
def test_a_turn_is_in_the_bin_whose_middle_is_nearest(turn):
    (index,) = bin_of(np.array([turn]))
    assert 0 <= index < BINS
    assert abs(float(wrap_angle(angle_of(np.array([index]))[0] - turn))) <= math.pi / BINS + 1e-9


def test_the_same_track_gives_the_same_ways_and_as_many_times_as_asked_for():
    torch.manual_seed(1)
    habits = LearnedHabits(HabitNetwork())
    walker, track = tracked([(0.0, 0.0), (9.0, 0.0)], 1.0, 5.0)
    times = [5.0, 6.0, 9.0]
    one, two = (habits(walker, track, times) for _ in range(2))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, LearnedHabits(habits._network)(walker, track, times))
    assert one.shape == (3, WAYS, 3)
    np.testing.assert_allclose(one[0, :, :2], [[5.0, 0.0]] * WAYS, atol=1e-6)


def test_who_was_seen_once_goes_on_as_it_does():
    walker = TrackedObstacle(1, ObstacleKind.PERSON, 0.0, 0.0, 1.0, 0.0, 0.25)
    track = np.array([[0.0, 0.0, 0.0, 1.0, 0.0]])
    poses = LearnedHabits(HabitNetwork())(walker, track, [0.0, 2.0])
    np.testing.assert_allclose(poses[1, 0], (2.0, 0.0, 0.0))


def test_the_shipped_weights_know_a_beat_that_they_have_seen():
    walker, track = tracked([(0.0, 0.0), (9.0, 0.0)], 1.0, 26.0)  # at 8 m, on the way to 9 m again
    poses = load_habits(SHIPPED)[0](walker, track, [26.0, 29.0])
    true, _, _ = patrol_pose([(0.0, 0.0), (9.0, 0.0)], 1.0, False, 0.0, 29.0)
    assert np.abs(poses[1, :, 0] - true).mean() < 0.8 and np.abs(poses[1, :, 1]).max() < 0.1


def test_the_shipped_weights_are_unsure_where_somebody_turns_for_the_first_time():
    walker, track = tracked([(0.0, 0.0), (40.0, 0.0)], 1.0, 4.0)
    ends = load_habits(SHIPPED)[0](walker, track, [4.0, 12.0])[1, :, 0]
    assert ends.max() == pytest.approx(12.0, abs=0.1) and ends.min() < 10.0


def test_weights_come_back_and_others_are_refused(tmp_path):
    torch.manual_seed(3)
    network = HabitNetwork()
    torch.nn.init.normal_(network.last.weight)
    named = save_habits(tmp_path / "w.safetensors", network)
    taught, again = load_habits(tmp_path / "w.safetensors")
    walker, track = tracked([(0.0, 0.0), (9.0, 0.0)], 1.0, 5.0)
    assert again == named
    expected = LearnedHabits(network)(walker, track, [7.0])
    np.testing.assert_array_equal(taught(walker, track, [7.0]), expected)
    save_network(tmp_path / "other.safetensors", ExposureNetwork((8, 8, 8)))
    with pytest.raises(PolicyError, match="exposure_unet"):
        load_habits(tmp_path / "other.safetensors")
    with pytest.raises(PolicyError, match="habit_mlp"):
        make_method("covernav", weights=POLICIES / "terp.safetensors")


def test_lessons_are_the_same_again_and_know_of_turns(monkeypatch):
    monkeypatch.setattr(habit_lessons, "PEOPLE", 2)
    monkeypatch.setattr(habit_lessons, "VEHICLES", 1)
    one, two = (habit_lessons.steps(5000) for _ in range(2))
    assert all(np.array_equal(one[name], two[name]) for name in one)
    assert one["features"].shape == (len(one["kinds"]), len(FEATURES)) and len(one["kinds"]) > 100
    assert one["kinds"].min() == -1 and one["kinds"].max() <= BINS


def test_it_learns_when_people_turn(tmp_path):
    rng, where = np.random.default_rng(0), FEATURES.index("steps_to_place")
    for seed in range(2):
        features = np.zeros((4000, len(FEATURES)), np.float32)
        features[:, where] = rng.uniform(0.0, 1.0, 4000)
        kinds = np.where(features[:, where] < 0.25, BINS, -1).astype(np.int8)
        np.savez(tmp_path / f"{seed}.npz", features=features, kinds=kinds)
    lessons = Lessons(scenes=1, held_out=1, seed=0, epochs=40)
    scores = [now for now, better in habit_lessons.learn(tmp_path, lessons) if better]
    assert scores[-1].turn < 0.3 * scores[-1].usual_turn
    card = json.loads((tmp_path / "covernav.json").read_text())
    assert card["steps"] == 4000 and card["validation"]["turn"] == scores[-1].turn


@pytest.mark.parametrize("content", [b"garbage", b""])
def test_samples_that_are_damaged_are_named(tmp_path, content):
    (tmp_path / "0.npz").write_bytes(content)
    with pytest.raises(TrainingRefusal, match=r"0\.npz is damaged"):
        habit_lessons.read(tmp_path, [0])


def test_samples_of_another_learner_are_refused(tmp_path):
    np.savez(tmp_path / "0.npz", layers=np.zeros(3))
    with pytest.raises(TrainingRefusal, match="of another learner"):
        habit_lessons.read(tmp_path, [0])


def test_a_loss_that_is_no_number_ends_the_training_and_is_named(tmp_path):
    for seed in range(2):
        features = np.full((10, len(FEATURES)), np.nan, np.float32)
        np.savez(tmp_path / f"{seed}.npz", features=features, kinds=np.full(10, -1, np.int8))
    with pytest.raises(TrainingError, match="loss 'turn' is nan after 0 epochs"):
        list(habit_lessons.learn(tmp_path, Lessons(scenes=1, held_out=1, seed=0, epochs=2)))


def test_the_shipped_weights_are_small_and_have_a_card():
    assert SHIPPED.stat().st_size < 5_000_000
    card = json.loads(SHIPPED.with_suffix(".json").read_text())
    assert {"command", "seed", "data", "steps", "figures", "weaknesses", "sha256"} <= set(card)
    method = make_method("covernav")
    assert isinstance(method, Learned) and method.policy.sha256 == card["sha256"]
    assert not isinstance(make_method("covernav[no_learning]"), Learned)


def test_covernav_leads_its_way_past_somebody_who_comes():
    method = make_method("covernav")
    walker, track = tracked([(3.0, -9.0), (3.0, 9.0)], 1.0, 6.0)  # at (3, -3), on its way north
    walker = replace(walker, x=3.0, y=-3.0, vx=0.0, vy=1.0)
    now = percept(grid_map(), Pose(0.0, 0.0, 0.0), (7.0, 0.0), time_s=6.0, moving=(walker,))
    straight = method.decide(replace(now, moving=()))
    method.reset()
    around = method.decide(replace(now, tracks={1: track}))
    assert straight.route is not None and around.route is not None
    assert np.abs(straight.route[:, 1]).max() < 0.3
    assert np.abs(around.route[:, 1]).max() > 0.6
