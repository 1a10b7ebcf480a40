"""A drive's way: two samples a second and its end, in whole centimetres."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from planner.trajectory import Trajectory, TrajectoryLog
from scenes.pose import Pose


def frame(time_s, x, y=0.0, yaw=0.0, seen=0.0):
    return SimpleNamespace(
        time_s=time_s, pose=Pose(x, y, 0.0, yaw=yaw), exposure=SimpleNamespace(fraction=seen)
    )


def logged(frames):
    log = TrajectoryLog()
    for one in frames:
        log.add(one)
    return log.document()


def test_samples_are_half_a_second_apart_and_the_end_is_kept():
    document = logged(frame(0.1 * tick, 0.1 * tick, seen=0.5) for tick in range(13))
    assert document["x_cm"] == [0, 50, 100, 120]
    assert document["seen_pct"] == [50] * 4 and document["end_s"] == pytest.approx(1.2)
    assert Trajectory.of(document).time_s.tolist() == pytest.approx([0.0, 0.5, 1.0, 1.2])


def test_a_drive_that_ends_on_a_sample_has_it_once():
    assert logged(frame(0.1 * tick, 0.1 * tick) for tick in range(11))["x_cm"] == [0, 50, 100]


def test_a_turn_past_half_a_circle_is_a_small_turn():
    document = logged([frame(0.0, 0.0, yaw=math.radians(170)), frame(0.5, 0.0, yaw=math.radians(-170))])
    way = Trajectory.of(document)
    assert way.at(0.25)[2] == pytest.approx(math.pi)


def test_before_and_after_the_drive_the_robot_stands():
    way = Trajectory.of(logged(frame(0.5 * i, 1.0 * i, -1.0 * i) for i in range(3)))
    assert way.at(-5.0)[:2] == (0.0, 0.0) and way.at(99.0)[:2] == (2.0, -2.0)
    assert way.at(0.75)[:2] == pytest.approx((1.5, -1.5))
    assert way.duration_s == 1.0 and isinstance(way.seen, np.ndarray)


@pytest.mark.parametrize(
    "change", [{"x_cm": [1]}, {"x_cm": None}, {"yaw_deg": ["a", "b"]}, {"end_s": "later"}]
)
def test_something_else_is_refused(change):
    good = logged([frame(0.0, 0.0), frame(0.5, 1.0)])
    with pytest.raises(ValueError, match="trajectory"):
        Trajectory.of(good | change)
