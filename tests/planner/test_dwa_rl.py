"""DWA-RL: what it reads of the window, what it may choose, what it is paid for, and that it can be learnt."""

import json
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from maps import drive, grid_map, percept

from planner.dwa import DwaConfig, Surroundings, window
from planner.dwa_rl import POLICY, LearnedMotion, open_window
from planner.dwa_rl_network import RowsArchitecture, WindowPolicy, load_window_policy, save_window_policy
from planner.dwa_rl_training import MotionLessons, choose_by, choose_by_weights, compare, judge, teach_motion
from planner.dwa_rl_window import WINDOW, MovingHistory, set_distances, velocities, view_window
from planner.dwa_rl_world import CrossingWorld, MotionReward, steering_behind
from planner.frames import Rejection, Status, TrackedObstacle
from planner.learning_errors import PolicyError
from planner.methods import make_method
from planner.tracking import outline_discs
from planner.way_out import evasive_arc
from scenes.pose import Pose, Twist
from scenes.scenario import OBSTACLE_SIZES, ObstacleKind

ORIGIN, CRUISING, DWA = Pose(0.0, 0.0, 0.0), Twist(0.5, 0.0), DwaConfig()
FAR = (2.0, 0.0)
NOTHING = np.zeros((0, 2))
NO_BEAMS = np.full(36, np.inf)


def person(x, y, vx=0.0, vy=0.0, identifier=1) -> TrackedObstacle:
    return TrackedObstacle(identifier, ObstacleKind.PERSON, x, y, vx, vy, 0.25)


def opened(points=NOTHING, moving=(), twist=CRUISING, history=None, max_speed=1.0, pose=ORIGIN):
    if history is None:
        history = MovingHistory()
        history.see(pose, moving)
    around = Surroundings(np.array(points, float).reshape(-1, 2), tuple(moving))
    return open_window(DWA, pose, twist, FAR, around, history, max_speed)


def at_rest(points, moving=()):
    """The view of arcs that all stand still at the origin."""
    poses = np.zeros((144, 16, 3))
    discs = np.array([(*disc, 9) for thing in moving for disc in outline_discs(thing)]).reshape(-1, 4)
    zeros = np.zeros(144)
    return view_window(zeros, zeros, poses, FAR, np.array(points, float).reshape(-1, 2), discs, DWA, 1.0)


class TestWindow:
    @given(v=st.floats(-0.3, 1.0), w=st.floats(-1.5, 1.5))
    @settings(max_examples=40, deadline=None)
    def test_the_velocities_span_what_can_be_reached_in_a_tick(self, v, w):
        speeds, rates = velocities(DWA, Twist(v, w))
        assert len(speeds) == len(rates) == len({*zip(speeds, rates, strict=True)}) == 144
        ends = speeds.min(), speeds.max(), rates.min(), rates.max()
        assert ends == pytest.approx(window(DWA, Twist(v, w)))
        assert abs(speeds - v).max() <= 0.3 + 1e-9 and abs(rates - w).max() <= 0.6 + 1e-9

    def test_rows_are_sorted_by_their_cost_among_the_newest_obstacles(self):
        view = opened(points=[(1.5, 0.3)]).view
        assert view.tensor.shape == (144, 10, 4)
        assert (np.diff(view.total) >= 0.0).all()
        assert sorted(view.order) == list(range(144))

    def test_velocities_and_to_goal_costs_are_the_same_in_all_sets(self):
        tensor = opened(points=[(1.5, 0.3)]).view.tensor
        for channel in (0, 1, 3):
            np.testing.assert_array_equal(tensor[:, :, channel], tensor[:, :1, channel].repeat(10, 1))

    def test_costs_are_shares_of_their_greatest(self):
        tensor = opened(points=[(1.5, 0.3)], moving=[person(2.0, -1.0)]).view.tensor
        for channel in (2, 3):
            assert tensor[:, :, channel].max() == 1.0 and tensor[:, :, channel].min() >= 0.0

    @pytest.mark.parametrize(
        ("away", "cost"), [(0.05, 40.0), (0.14, 40.0), (0.5, 2.0), (2.0, 0.5), (3.4, 1.0 / 3.4), (3.6, 0.0)]
    )
    def test_an_obstacle_costs_by_its_distance_from_the_outline_and_nothing_beyond_four_metres(
        self, away, cost
    ):
        view = at_rest([(0.495 + away, 0.0)])
        spent = view.total[0] - WINDOW.goal_gain * FAR[0] - WINDOW.speed_gain
        assert spent == pytest.approx(WINDOW.obstacle_gain * cost)

    def test_what_moves_costs_where_it_is_now(self):
        near, far = (at_rest(NOTHING, [person(x, 0.0)]).total[0] for x in (1.5, 3.0))
        assert near - far == pytest.approx(3.2 * (1.0 / (1.005 - 0.25) - 1.0 / (2.505 - 0.25)), rel=1e-6)

    def test_the_last_sets_lie_half_a_second_apart(self):
        history = MovingHistory()
        for tick in range(60):
            history.see(ORIGIN, [person(3.0 - 0.04 * tick, 0.0)])
        discs = history.discs()
        assert discs[:, 3].tolist() == list(range(10))
        assert discs[-1, 0] == pytest.approx(3.0 - 0.04 * 59)
        np.testing.assert_allclose(np.diff(discs[:-1, 0]), -0.2)

    def test_at_first_all_sets_are_the_same(self):
        history = MovingHistory()
        history.see(ORIGIN, [person(2.0, 0.0), person(9.0, 0.0, identifier=2)])
        assert len(history.discs()) == 10 and (history.discs()[:, 0] == 2.0).all()


def plain_distances(poses, half, points, discs, sets):
    """`set_distances`, one corner at a time."""
    best = np.full((len(poses), sets), np.inf)
    rows = [(*point, 0.0, number) for point in points for number in range(sets)] + [*map(tuple, discs)]
    for i, arc in enumerate(poses):
        for x, y, yaw in arc:
            for px, py, radius, number in rows:
                ahead = math.cos(yaw) * (px - x) + math.sin(yaw) * (py - y)
                left = math.cos(yaw) * (py - y) - math.sin(yaw) * (px - x)
                away = math.hypot(max(abs(ahead) - half[0], 0.0), max(abs(left) - half[1], 0.0)) - radius
                best[i, int(number)] = min(best[i, int(number)], away)
    return best


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_agrees_with_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    poses = rng.normal(0.0, 1.0, (6, 4, 3))
    points, discs = rng.normal(0.0, 2.0, (seed, 2)), rng.normal(0.0, 3.0, (4, 4))
    discs[:, 2:] = np.column_stack([rng.uniform(0.1, 1.0, 4), rng.integers(0, 3, 4)])
    half = np.array([0.495, 0.335])
    ours = set_distances(poses, half, points, discs, 3)
    np.testing.assert_allclose(ours, plain_distances(poses, half, points, discs, 3), atol=1e-12)


@given(
    x=st.floats(-5, 5), y=st.floats(-5, 5), course=st.floats(-math.pi, math.pi), speed=st.floats(0.5, 4.0)
)
@settings(max_examples=40, deadline=None)
def test_three_discs_hold_a_vehicle_on_its_way(x, y, course, speed):
    length, width, _ = OBSTACLE_SIZES[ObstacleKind.VEHICLE]
    cos, sin = math.cos(course), math.sin(course)
    car = TrackedObstacle(1, ObstacleKind.VEHICLE, x, y, speed * cos, speed * sin, 2.4)
    discs = np.array(outline_discs(car))
    along, across = np.meshgrid(np.linspace(-0.5, 0.5, 23) * length, np.linspace(-0.5, 0.5, 9) * width)
    outline = np.stack([x + cos * along - sin * across, y + sin * along + cos * across], axis=-1)
    gap = np.hypot(*(outline.reshape(-1, 1, 2) - discs[:, :2]).transpose(2, 0, 1)) - discs[:, 2]
    assert len(discs) == 3 and gap.min(axis=1).max() < 1e-9
    assert discs[:, 2].max() < 1.3


def test_a_vehicle_that_stands_may_face_any_way():
    car = TrackedObstacle(1, ObstacleKind.VEHICLE, 1.0, 2.0, 0.1, 0.0, 2.4)
    assert outline_discs(car) == [(1.0, 2.0, 2.4)]


def perverse(path):
    """Weights that like the dearest row best."""
    policy = WindowPolicy(RowsArchitecture(eagerness=-50.0))
    save_window_policy(path, policy)
    return path


@pytest.mark.parametrize("seed", range(12))
def test_whatever_it_has_learnt_it_chooses_nothing_that_the_window_rejects(seed, tmp_path):
    rng = np.random.default_rng(seed)
    motion = LearnedMotion(perverse(tmp_path / "w.safetensors"))
    twist = Twist(rng.uniform(0.0, 1.0), rng.uniform(-1.0, 1.0))
    moving = (person(rng.uniform(0.8, 3.0), rng.uniform(-2.0, 2.0), 0.0, rng.uniform(-1.0, 1.0)),)
    points = rng.uniform(-2.5, 2.5, (6, 2))
    now = percept(grid_map(), ORIGIN, moving=moving, twist=twist)
    motion.see(now)
    arcs = motion.arcs(DWA, now, FAR, Surroundings(points, moving), 1.0).arcs
    free = arcs.rejection == Rejection.NONE
    assert (arcs.chosen >= 0) == free.any()
    if arcs.chosen >= 0:
        assert free[arcs.chosen]
        assert abs(arcs.v[arcs.chosen] - twist.v) <= 0.3 + 1e-9
        assert abs(arcs.w[arcs.chosen] - twist.w) <= 0.6 + 1e-9


def test_near_the_goal_faster_rows_are_masked_unless_all_are():
    slow = opened(twist=Twist(0.4, 0.0), max_speed=0.5)
    v = slow.rollout.arcs.v[slow.view.order]
    assert v[slow.admissible].max() <= 0.5 + 1e-9 < v.max()
    fast = opened(twist=Twist(1.0, 0.0), max_speed=0.3)
    assert fast.rollout.arcs.v[fast.view.order][fast.admissible].max() == pytest.approx(0.7)


class TestPolicy:
    def test_before_it_has_learnt_the_cheapest_admissible_row_is_the_likeliest(self):
        policy = WindowPolicy()
        tensor, admissible = torch.rand(3, 144, 10, 4), torch.rand(3, 144) > 0.7
        logits, value = policy(tensor, admissible)
        assert logits.argmax(1).tolist() == admissible.int().argmax(1).tolist()
        assert (torch.softmax(logits, 1)[~admissible] == 0.0).all()
        assert value.shape == (3,)

    def test_it_is_the_same_after_a_trip_to_disk(self, tmp_path):
        torch.manual_seed(1)
        policy = WindowPolicy()
        torch.nn.init.normal_(policy.score.weight)
        name = save_window_policy(tmp_path / "w.safetensors", policy)
        again, named = load_window_policy(tmp_path / "w.safetensors")
        given = torch.rand(1, 144, 10, 4), torch.ones(1, 144, dtype=torch.bool)
        assert torch.equal(policy(*given)[0], again(*given)[0]) and name == named

    def test_what_is_no_policy_is_refused(self, tmp_path):
        (tmp_path / "w.safetensors").write_bytes(b"no weights")
        with pytest.raises(PolicyError, match="not a safetensors file"):
            LearnedMotion(tmp_path / "w.safetensors")
        with pytest.raises(PolicyError, match="dwa_rl_rows"):
            load_window_policy(POLICY.with_name("covernav_paper.safetensors"))


class TestReward:
    reward = MotionReward()

    def paid(self, nearer=0.0, status=Status.RUNNING, beams=NO_BEAMS, w=0.0, moving=()):
        return self.reward(nearer, status, beams, ORIGIN, w, moving)

    def test_a_metre_nearer_pays_one_and_standing_still_nothing(self):
        assert self.paid(1.0) == 1.0 and self.paid() == 0.0

    def test_a_collision_costs_ten_metres_and_arriving_pays_two_and_a_half(self):
        assert self.paid(status=Status.COLLIDED) == -10.0 and self.paid(status=Status.REACHED) == 2.5

    def test_beams_cost_by_their_length_and_more_below_two_metres(self):
        beams = np.array([4.0, 1.0, np.inf])
        assert self.paid(beams=beams) == pytest.approx((-1.0 / 4.0 - 3.5 / 1.0) / 200.0)

    @pytest.mark.parametrize(("vy", "w"), [(1.0, -1.0), (-1.0, 1.0)])
    def test_steering_against_the_heading_of_what_crosses_pays_and_with_it_costs(self, vy, w):
        crossing = (person(2.0, -2.0 * vy, 0.0, vy),)
        behind, before = (steering_behind(ORIGIN, rate, crossing) for rate in (w, -w))
        assert behind == -before > 0.0
        assert self.paid(w=w, moving=crossing) == pytest.approx(4.0 * behind / 200.0)

    @pytest.mark.parametrize(
        "thing",
        [person(2.0, 2.0, 0.0, 1.0), person(-2.0, -2.0, 0.0, 1.0), person(9.0, -2.0, 0.0, 1.0),
         person(3.0, 0.5, -1.0, 0.0), person(2.0, -2.0), person(2.0, -9.0, 0.0, 1.0)],
        ids=["gone by", "behind", "far ahead", "oncoming", "standing", "much later"],
    )  # fmt: skip
    def test_where_nothing_is_about_to_cross_steering_is_free(self, thing):
        assert steering_behind(ORIGIN, 1.0, (thing,)) == 0.0


def test_evading_is_away_from_what_comes():
    """Someone walks into the robot's left side: of the arcs that are met last, one that leaves."""
    comes = (person(0.2, 0.75, 0.0, -1.2),)
    seen = opened(moving=comes, twist=Twist())
    assert not seen.admissible.any()
    index = evasive_arc(seen.rollout, comes, DWA.dt)
    end = seen.rollout.arcs.poses[index, -1]
    then = np.array([0.2, 0.75 - 1.2 * WINDOW.horizon])
    assert np.hypot(*(end[:2] - then)) >= np.hypot(*then)


class TestWorld:
    def test_the_same_seed_gives_the_same_drive(self):
        one, two = (judge(choose_by_weights, 2, seed=5) for _ in range(2))
        assert one == two

    def test_what_is_compared_on_decided_nothing(self):
        policy = WindowPolicy()
        found = compare(policy, 2, seed=5)
        assert set(found) == {"dwa_rl", "dwa"}
        assert found == compare(policy, 2, seed=5)
        assert found["dwa"] != judge(choose_by_weights, 2, seed=5)

    def test_there_is_always_something_to_choose(self):
        world = CrossingWorld(np.random.default_rng(3))
        for _ in range(60):
            assert world.window.admissible.any()
            world.step(choose_by_weights(world.window))
            if world.over:
                world.reset()

    def test_learning_is_the_same_for_the_same_seed_and_changes_the_policy(self, tmp_path):
        lessons = MotionLessons(decisions=32, worlds=2, round=16, batch=16, judged=1)
        runs = [list(teach_motion(tmp_path / f"{k}.safetensors", lessons)) for k in (0, 1)]
        assert runs[0] == runs[1] and [each.decisions for each in runs[0]] == [0, 32]
        assert runs[0][0].best and runs[0][-1].judged is not None
        files = [(tmp_path / f"{k}.safetensors").read_bytes() for k in (0, 1)]
        assert files[0] == files[1]


def test_the_shipped_weights_are_small_and_have_a_card():
    assert POLICY.stat().st_size < 5_000_000
    card = json.loads(POLICY.with_suffix(".json").read_text())
    assert {"command", "seed", "data", "steps", "figures", "weaknesses", "sha256"} <= set(card)
    assert card["sha256"] == LearnedMotion().policy.sha256


@pytest.mark.parametrize("name", ["dwa+dwa_rl", "least_cost+dwa_rl"])
def test_a_method_drives_by_it_to_its_goal(name):
    method = make_method(name)
    assert method.driver.motion.name == "dwa_rl"
    now, decision = drive(method.decide, grid_map(), ORIGIN)[-1]
    assert now.goal_distance < 0.35 and decision.failure is None


def test_it_can_be_pickled_in_the_middle_of_a_drive():
    method = make_method("dwa+dwa_rl")
    crossing = (person(4.0, -2.0, 0.0, 0.6),)
    log = drive(method.decide, grid_map(), ORIGIN, ticks=8, moving=lambda time_s: crossing)
    twin = pickle.loads(pickle.dumps(method))
    assert twin.decide(log[-1][0]).command == method.decide(log[-1][0]).command


def test_an_unknown_motion_is_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"'teleport'.*dwa, dwa_rl"):
        make_method("dwa+teleport")


def test_naming_it_does_not_import_torch():
    code = "import sys, planner.methods, planner.motion; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_an_untaught_policy_can_be_judged():
    assert 0.0 <= judge(choose_by(WindowPolicy()), 1, seed=0).success <= 1.0
