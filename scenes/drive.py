"""Skid-steer drive: turns a commanded twist into wheel speeds, closing the loop on the measured twist.

A skid-steered robot turns less than its wheels suggest, because they must slide sideways to turn at all.
A feed-forward widened track gives most of it (as Clearpath's controller does), integral action the rest.
"""

from __future__ import annotations

from typing import NamedTuple

from scenes.husky import AXLE_Y, WHEEL_RADIUS
from scenes.pose import Twist
from scenes.robot import HUSKY

TRACK_FACTOR = 1.4
SPEED_GAIN, SPEED_INTEGRAL_GAIN = 0.2, 2.0
YAW_INTEGRAL_GAIN = 2.0
MAX_SPEED_CORRECTION = 0.3
MAX_YAW_CORRECTION = 3.0
MAX_WHEEL_SPEED = 14.0


class DriveState(NamedTuple):
    """The reference that follows the command within the acceleration limits, and the integrals."""

    v: float = 0.0
    w: float = 0.0
    speed_correction: float = 0.0
    yaw_correction: float = 0.0


def clipped(command: Twist) -> Twist:
    """The command within the Husky's limits."""
    return Twist(
        _clip(command.v, -HUSKY.max_reverse_speed, HUSKY.max_speed),
        _clip(command.w, -HUSKY.max_yaw_rate, HUSKY.max_yaw_rate),
    )


def drive(state: DriveState, command: Twist, measured: Twist, dt: float) -> tuple[DriveState, float, float]:
    """The next state and the left and right wheel speeds in rad/s, `dt` seconds after the last."""
    v_step, w_step = HUSKY.max_acceleration * dt, HUSKY.max_yaw_acceleration * dt
    v = state.v + _clip(command.v - state.v, -v_step, v_step)
    w = state.w + _clip(command.w - state.w, -w_step, w_step)
    speed_error, yaw_error = v - measured.v, w - measured.w
    speed_correction = _clip(
        state.speed_correction + SPEED_INTEGRAL_GAIN * speed_error * dt,
        -MAX_SPEED_CORRECTION,
        MAX_SPEED_CORRECTION,
    )
    yaw_correction = _clip(
        state.yaw_correction + YAW_INTEGRAL_GAIN * yaw_error * dt, -MAX_YAW_CORRECTION, MAX_YAW_CORRECTION
    )
    forward = v + speed_correction + SPEED_GAIN * speed_error
    turning = TRACK_FACTOR * w + yaw_correction
    left = (forward - AXLE_Y * turning) / WHEEL_RADIUS
    right = (forward + AXLE_Y * turning) / WHEEL_RADIUS
    return (
        DriveState(v, w, speed_correction, yaw_correction),
        _clip(left, -MAX_WHEEL_SPEED, MAX_WHEEL_SPEED),
        _clip(right, -MAX_WHEEL_SPEED, MAX_WHEEL_SPEED),
    )


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value
