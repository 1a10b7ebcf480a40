"""The dynamic window: which velocities are candidates, which are admissible, and which one wins."""

import math
from dataclasses import replace

import numpy as np
import plain_dwa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import dwa_kernel
from planner.dwa import (
    NO_SLIP,
    DwaConfig,
    Footprint,
    Ground,
    Slip,
    Surroundings,
    Weights,
    candidates,
    evaluate,
    window,
)
from planner.frames import Rejection, TrackedObstacle
from scenes.pose import Pose, Twist
from scenes.robot import HUSKY
from scenes.scenario import ObstacleKind

CONFIG = DwaConfig()
ORIGIN = Pose(0.0, 0.0, 0.0)
NOTHING = Surroundings(np.zeros((0, 2)))
WHEELS = np.array([(0.256, 0.2854), (0.256, -0.2854), (-0.256, 0.2854), (-0.256, -0.2854)])


def rejection_of(v, w, surroundings, config=CONFIG, pose=ORIGIN, slip=NO_SLIP):
    rollout = evaluate(config, np.array([v]), np.array([w]), pose, (10.0, 0.0), surroundings, slip=slip)
    return Rejection(int(rollout.arcs.rejection[0]))


def ground(elevation, forbidden=None, resolution=0.2):
    """A square map about the origin."""
    half = 0.5 * (len(elevation) - 1) * resolution
    blocked = np.zeros(elevation.shape, bool) if forbidden is None else forbidden
    return Ground(-half, -half, resolution, elevation, blocked)


def test_window_is_what_the_accelerations_reach_in_a_control_period_within_the_limits():
    assert window(CONFIG, Twist(0.5, 0.0)) == pytest.approx((0.2, 0.8, -0.6, 0.6))
    assert window(CONFIG, Twist(1.0, 1.5)) == pytest.approx((0.7, 1.0, 0.9, 1.5))
    assert window(CONFIG, Twist(-0.3, 0.0))[0] == -HUSKY.max_reverse_speed


@given(st.floats(-1.0, 2.0), st.floats(-3.0, 3.0))
def test_candidates_stay_in_the_window_and_hold_its_corners(v, w):
    low_v, high_v, low_w, high_w = window(CONFIG, Twist(v, w))
    all_v, all_w = candidates(CONFIG, Twist(v, w))
    assert {all_v.min(), all_v.max()} == {low_v, high_v}
    assert {all_w.min(), all_w.max()} == {low_w, high_w}


@pytest.mark.parametrize("twist", [Twist(0.0, 0.0), Twist(0.13, -0.4), Twist(0.2, 0.5)])
def test_standing_still_driving_straight_and_turning_on_the_spot_are_candidates_when_in_reach(twist):
    v, w = candidates(CONFIG, twist)
    assert ((v == 0.0) & (w == 0.0)).any()
    assert ((v > 0.0) & (w == 0.0)).any()
    assert ((v == 0.0) & (w > 0.2)).any()


def test_arcs_follow_the_circle_of_their_velocities():
    rollout = evaluate(
        CONFIG, np.array([0.8]), np.array([1.0]), Pose(1.0, 2.0, 0.0, yaw=0.3), (9, 9), NOTHING
    )
    x, y, yaw = rollout.arcs.poses[0, -1]
    radius = 0.8
    assert yaw == pytest.approx(2.3)
    assert x == pytest.approx(1.0 + radius * (math.sin(2.3) - math.sin(0.3)), abs=2e-3)
    assert y == pytest.approx(2.0 - radius * (math.cos(2.3) - math.cos(0.3)), abs=2e-3)


def test_a_robot_that_pivots_about_its_rear_axle_is_foreseen_to_swing_its_middle():
    rollout = evaluate(CONFIG, np.zeros(1), np.ones(1), ORIGIN, (9, 9), NOTHING, slip=Slip(turning=0.25))
    x, y, yaw = rollout.arcs.poses[0, -1]
    assert (x, y) == pytest.approx((0.25 * (math.cos(yaw) - 1.0), 0.25 * math.sin(yaw)), abs=1e-3)


@pytest.mark.parametrize("v", [0.5, -0.3])
def test_a_robot_that_slides_down_a_side_slope_is_foreseen_to_drift(v):
    rollout = evaluate(CONFIG, np.array([v]), np.zeros(1), ORIGIN, (9, 9), NOTHING, slip=Slip(driving=-0.2))
    assert rollout.arcs.poses[0, -1] == pytest.approx((2.0 * v, -0.2 * 2.0 * abs(v), 0.0))


def test_out_of_a_margin_the_robot_only_drives_where_it_does_not_come_nearer_in_the_end():
    def wall(share):
        y = 0.5 * HUSKY.width + share * CONFIG.contact_distance
        return Surroundings(np.column_stack([np.linspace(-3.0, 3.0, 121), np.full(121, y)]))

    assert rejection_of(0.2, 0.0, wall(0.9)) is Rejection.NONE
    assert rejection_of(0.2, 0.0, wall(0.5)) is Rejection.COLLISION
    assert rejection_of(0.2, 0.0, wall(0.5), slip=Slip(driving=-0.1)) is Rejection.NONE
    assert rejection_of(0.0, 0.0, wall(0.5)) is Rejection.NONE


def test_nothing_in_the_way_rejects_nothing_and_the_best_heads_for_the_target():
    v, w = candidates(CONFIG, Twist(0.8, 0.0))
    arcs = evaluate(CONFIG, v, w, ORIGIN, (10.0, 0.0), NOTHING).arcs
    assert not arcs.rejection.any()
    assert (arcs.v[arcs.chosen], arcs.w[arcs.chosen]) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("gap", "v", "expected"),
    [
        (3.0, 1.0, Rejection.NONE),
        (0.95, 1.0, Rejection.NONE),
        (0.65, 1.0, Rejection.CANNOT_STOP),
        (0.65, 0.3, Rejection.NONE),
        (0.4, 1.0, Rejection.COLLISION),
    ],
)
def test_admissible_means_able_to_stop_before_contact(gap, v, expected):
    wall = np.array([(0.5 * HUSKY.length + gap, y) for y in np.linspace(-1.0, 1.0, 21)])
    assert rejection_of(v, 0.0, Surroundings(wall)) == expected


def test_without_braking_an_arc_must_be_free_over_its_whole_horizon():
    config = replace(CONFIG, braking=0.0, yaw_braking=0.0)
    point = Surroundings(np.array([[2.0, 0.0]]))
    assert rejection_of(1.0, 0.0, point) == Rejection.NONE
    assert rejection_of(1.0, 0.0, point, config) == Rejection.CANNOT_STOP
    assert rejection_of(0.0, 0.0, point, config) == Rejection.NONE


def test_more_room_is_kept_at_speed():
    beside = Surroundings(np.array([[1.0, 0.5 * HUSKY.width + 0.22]]))
    assert rejection_of(0.4, 0.0, beside) == Rejection.NONE
    assert rejection_of(1.0, 0.0, beside) != Rejection.NONE


def test_a_robot_inside_a_margin_may_leave_slowly_but_not_come_nearer():
    ahead = Surroundings(np.array([[0.5 * HUSKY.length + 0.1, 0.0]]))
    assert rejection_of(-0.2, 0.0, ahead) == Rejection.NONE
    assert rejection_of(0.2, 0.0, ahead) != Rejection.NONE


def test_moving_obstacles_are_met_where_they_will_be():
    def crossing(y, vy):
        return Surroundings(
            np.zeros((0, 2)), (TrackedObstacle(1, ObstacleKind.PERSON, 1.5, y, 0.0, vy, 0.3),)
        )

    assert rejection_of(1.0, 0.0, crossing(1.5, -1.0)) == Rejection.MOVING_OBSTACLE
    assert rejection_of(1.0, 0.0, crossing(1.5, 1.0)) == Rejection.NONE
    assert rejection_of(1.0, 0.0, crossing(0.0, 2.0)) == Rejection.NONE


@pytest.mark.parametrize(
    ("change", "expected"),
    [("forbidden", Rejection.SLOPE), ("ramp", Rejection.TILT), ("edge", Rejection.OFF_THE_MAP)],
)
def test_ground_that_cannot_be_driven_rejects_fast_arcs(change, expected):
    elevation, forbidden = np.zeros((21, 21)), np.zeros((21, 21), bool)
    if change == "forbidden":
        forbidden[:, 14:] = True
    elif change == "ramp":
        elevation[:, 11:] = 0.2 * np.arange(10)
    else:
        elevation, forbidden = elevation[:, :13], forbidden[:, :13]
    surroundings = Surroundings(np.zeros((0, 2)), (), Ground(-2.0, -2.0, 0.2, elevation, forbidden))
    assert rejection_of(1.0, 0.0, surroundings) == expected
    assert rejection_of(0.0, 0.5, surroundings) == Rejection.NONE


def test_rolling_on_a_side_slope_is_limited_more_than_pitching_up_it():
    x, _ = np.meshgrid(0.2 * np.arange(31), np.arange(31))
    slope = Surroundings(np.zeros((0, 2)), (), ground(math.tan(math.radians(22.5)) * x))
    assert rejection_of(0.8, 0.0, slope) == Rejection.NONE
    assert rejection_of(0.0, 1.2, slope, pose=Pose(0.0, 0.0, 0.0, yaw=0.8)) == Rejection.TILT


def test_unknown_ground_may_be_entered_at_a_creep_only_and_costs():
    elevation = np.zeros((31, 31))
    elevation[:, 17:] = np.nan
    surroundings = Surroundings(np.zeros((0, 2)), (), ground(elevation))
    assert rejection_of(1.0, 0.0, surroundings) == Rejection.UNKNOWN_GROUND
    v = np.array([CONFIG.creep_speed, -0.3])
    arcs = evaluate(CONFIG, v, np.zeros(2), ORIGIN, (9.0, 0.0), surroundings).arcs
    assert not arcs.rejection.any()
    assert arcs.ground[0] > arcs.ground[1]


def test_nothing_admissible_chooses_nothing():
    around = np.array([(0.52 * math.cos(a), 0.52 * math.sin(a)) for a in np.linspace(0, 6.2, 40)])
    arcs = evaluate(
        CONFIG, np.array([0.8, 1.0]), np.array([0.0, 0.2]), ORIGIN, (9, 0), Surroundings(around)
    ).arcs
    assert arcs.chosen == -1
    assert np.isinf(arcs.total).all()


def test_terms_add_up_to_the_total_of_what_is_admissible():
    v, w = candidates(CONFIG, Twist(0.5, 0.2))
    points = Surroundings(np.array([[1.1, 0.3], [1.0, -1.5]]))
    arcs = evaluate(CONFIG, v, w, ORIGIN, (5.0, 3.0), points).arcs
    total = arcs.heading + arcs.clearance + arcs.velocity + arcs.goal + arcs.ground
    fine = arcs.rejection == Rejection.NONE
    assert 0 < fine.sum() < len(fine)
    np.testing.assert_allclose(arcs.total[fine], total[fine])
    assert arcs.total[arcs.chosen] == arcs.total[fine].min()


def test_the_same_question_has_the_same_answer():
    v, w = candidates(CONFIG, Twist(0.5, 0.2))
    points = Surroundings(np.random.default_rng(1).uniform(-4, 4, (50, 2)))
    one, two = (evaluate(CONFIG, v, w, ORIGIN, (5.0, 3.0), points).arcs for _ in range(2))
    np.testing.assert_array_equal(one.total, two.total)
    np.testing.assert_array_equal(one.poses, two.poses)


def test_a_round_robot_with_pythonrobotics_terms_can_be_asked():
    """Heading weight 0.15, speed 1, obstacle 1 / distance, no braking, Euler steps: its defaults."""
    config = DwaConfig(
        max_speed=1.0, min_speed=-0.5, max_yaw_rate=math.radians(40), acceleration=0.2,
        yaw_acceleration=math.radians(40), horizon=3.1, heading_share=1.0, braking=0.0, yaw_braking=0.0,
        reaction=0.0, margin=0.0, speed_margin=0.0, escape_speed=0.0, point_radius=0.0,
        clearance_reach=math.inf, footprint=Footprint(0.0, 0.0, 1.0),
        weights=Weights(0.15, 1.0, 1.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    points = np.array([[4.0, 2.0], [5.0, 4.0], [1.0, 1.3], [2.0, -0.5]])
    v, w = np.array([0.5, 0.52, 0.48]), np.array([0.0, 0.6, -0.3])
    arcs = evaluate(config, v, w, ORIGIN, (10.0, 10.0), Surroundings(points)).arcs
    assert config.steps == 31
    for i in range(3):
        x = y = yaw = 0.0
        nearest = min(math.hypot(*point) for point in points)
        for _ in range(31):
            yaw += w[i] * 0.1
            x, y = x + v[i] * math.cos(yaw) * 0.1, y + v[i] * math.sin(yaw) * 0.1
            nearest = min(nearest, *(math.dist((x, y), point) for point in points))
        error = math.atan2(10 - y, 10 - x) - yaw
        expected = 0.15 * abs(math.atan2(math.sin(error), math.cos(error))) + (1.0 - v[i]) + 1.0 / nearest
        assert arcs.total[i] == pytest.approx(expected if nearest > 1.0 else math.inf, abs=1e-9)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_kernel_agrees_with_its_plain_twin(seed):
    rng = np.random.default_rng(seed)
    start = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-4, 4)])
    points = rng.uniform(-2.5, 2.5, (rng.integers(0, 25), 2))
    ranges = np.hypot(*(points - start[:2]).T)
    order = np.argsort(ranges)
    ranked = np.column_stack([points, ranges])[order]
    moving = rng.uniform([-2, -2, -1, -1, 0.3], [2, 2, 1, 1, 0.6], (rng.integers(0, 3), 5))
    elevation = np.cumsum(rng.normal(0.0, rng.choice([0.01, 0.05]), (31, 31)), axis=1)
    elevation[rng.random((31, 31)) < rng.choice([0.0, 0.1])] = np.nan
    forbidden = rng.random((31, 31)) < rng.choice([0.0, 0.03])
    if rng.random() < 0.3:
        elevation, forbidden = np.zeros((0, 0)), np.zeros((0, 0), bool)
    arguments = (
        rng.uniform(-0.3, 1.0, 12), rng.uniform(-1.5, 1.5, 12), rng.choice([0.0, -0.3, 0.2], 2), start,
        rng.uniform(-5, 5, 2), 20, 0.1,
        rng.choice([0.5, 1.0]), rng.choice([0.0, 1.5]) * np.array([1.0, 2.0]), rng.choice([0.0, 0.2]), 0.4,
        rng.choice([0.0, 1.0]) * np.array([0.5, 0.33]), rng.uniform(0.1, 0.4), rng.choice([0.0, 0.1]), 0.3,
        rng.choice([0.0, 0.04, 0.8], 3),
        ranked, moving, elevation, forbidden, np.array([-3.0, -3.0, 0.2]), WHEELS, np.tan([0.4, 0.3]),
    )  # fmt: skip
    ours, plain = dwa_kernel.roll_out(*arguments), plain_dwa.roll_out(*arguments)
    np.testing.assert_array_equal(ours[-1], plain[-1])
    np.testing.assert_allclose(ours[0], plain[0], atol=1e-9)
    for mine, theirs in zip(ours[1:-1], plain[1:-1], strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2.0, math.inf]))
def test_weighing_agrees_with_its_plain_twin(seed, reach):
    rng = np.random.default_rng(seed)
    v, heading, nearest, distance, unknown, tilt = rng.uniform(0.0, 3.0, (6, 9))
    nearest[rng.random(9) < 0.2] = rng.choice([0.0, np.inf])
    rejection = rng.choice([0, 0, 1, 5], 9).astype(np.int8)
    weights = rng.uniform(0.0, 1.0, 6)
    terms, total, chosen = dwa_kernel.weigh(
        v, heading, nearest, distance, unknown, tilt, rejection, *weights, 0.8, reach
    )
    with np.errstate(divide="ignore"):
        closeness = np.maximum(0.0, 1.0 / nearest - 1.0 / reach)
    ground = weights[4] * unknown + weights[5] * tilt
    plain = [
        weights[0] * heading, weights[1] * closeness, weights[2] * abs(0.8 - v), weights[3] * distance, ground
    ]  # fmt: skip
    np.testing.assert_array_equal(terms, plain)
    np.testing.assert_array_equal(total, np.where(rejection == 0, sum(plain), np.inf))
    assert chosen == (int(np.argmin(total)) if np.isfinite(total).any() else -1)
