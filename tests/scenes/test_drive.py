import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.drive import (
    MAX_SPEED_CORRECTION,
    MAX_WHEEL_SPEED,
    MAX_YAW_CORRECTION,
    DriveState,
    clipped,
    drive,
)
from scenes.husky import WHEEL_RADIUS
from scenes.pose import Twist
from scenes.robot import HUSKY

DT = 1.0 / 240.0
STILL = Twist()


def test_commands_are_kept_within_the_robots_limits() -> None:
    assert clipped(Twist(5.0, -9.0)) == Twist(HUSKY.max_speed, -HUSKY.max_yaw_rate)
    assert clipped(Twist(-5.0, 9.0)) == Twist(-HUSKY.max_reverse_speed, HUSKY.max_yaw_rate)
    assert clipped(Twist(0.4, 0.2)) == Twist(0.4, 0.2)


def test_the_reference_gathers_speed_within_the_acceleration_limits() -> None:
    state, steps = DriveState(), 0
    while state.v < 0.9:
        following = Twist(state.v, state.w)
        state, _, _ = drive(state, Twist(0.9, 1.2), following, DT)
        steps += 1
        assert state.v <= steps * DT * HUSKY.max_acceleration + 1e-9
        assert state.w <= steps * DT * HUSKY.max_yaw_acceleration + 1e-9
    assert steps * DT == pytest.approx(0.9 / HUSKY.max_acceleration, abs=2 * DT)


def test_driving_straight_as_told_turns_all_wheels_alike_without_correction() -> None:
    state, left, right = drive(DriveState(v=0.5), Twist(0.5), Twist(0.5), DT)
    assert left == right == pytest.approx(0.5 / WHEEL_RADIUS)
    assert (state.speed_correction, state.yaw_correction) == (0.0, 0.0)


def test_a_left_turn_drives_the_right_wheels_faster() -> None:
    _, left, right = drive(DriveState(w=1.0), Twist(0.0, 1.0), Twist(0.0, 1.0), DT)
    assert left == -right < 0.0


@pytest.mark.parametrize(("measured", "faster"), [(Twist(0.3), True), (Twist(0.7), False)])
def test_what_is_measured_corrects_the_speed(measured: Twist, faster: bool) -> None:
    _, left, right = drive(DriveState(v=0.5), Twist(0.5), measured, DT)
    assert (left > 0.5 / WHEEL_RADIUS) is faster
    assert (right > 0.5 / WHEEL_RADIUS) is faster


def test_a_robot_held_fast_winds_nothing_up() -> None:
    state = DriveState()
    for _ in range(240 * 20):
        state, _, _ = drive(state, Twist(1.0, 1.5), STILL, DT)
    assert state.speed_correction == MAX_SPEED_CORRECTION
    assert state.yaw_correction == MAX_YAW_CORRECTION


@given(*[st.floats(-50, 50) for _ in range(6)])
def test_wheel_speeds_stay_within_the_motors(v, w, state_v, state_w, measured_v, measured_w) -> None:
    state = DriveState(state_v, state_w)
    _, left, right = drive(state, Twist(v, w), Twist(measured_v, measured_w), DT)
    assert max(abs(left), abs(right)) <= MAX_WHEEL_SPEED
