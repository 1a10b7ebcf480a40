"""A leg's totals and the summary that scripts read."""

import math

import numpy as np
import pytest
from maps import grid_map

from planner.frames import CoverEstimate, Detection, Percept, Perception, Status
from planner.leg import Leg, in_cover, usual_time_limit
from scenes.catalogue import CoverKind
from scenes.pose import Pose, Twist

KEYS = [
    *("scenario", "method", "perception", "seed", "status", "success"),
    *("trajectory_length_m", "straight_line_m", "execution_time_s"),
    *("exposure_fraction", "exposed_s", "longest_exposure_s", "detection_probability", "cover_fraction"),
    *("collisions", "max_roll_deg", "max_pitch_deg", "planner_ms_p50", "planner_ms_p95", "policy"),
    *("expected_detection_s", "concealed_fraction", "by_observer", "elevation_gradient_m"),
    "dynamic_violations",
]


def leg() -> Leg:
    return Leg(2.0, Pose(0.0, 0.0, 1.0), (3.0, 4.0), 60.0)


def percept(perception=Perception.LIDAR, detections=(), cover=()):
    return Percept(
        0.0, perception, Pose(0.0, 0.0, 0.0), Twist(), (5.0, 0.0), grid_map(),
        np.zeros((40, 40)), np.zeros((40, 40), bool), np.zeros((0, 2)), np.full(72, np.inf),
        detections=detections, cover=cover,
    )  # fmt: skip


def bush(x, confidence):
    return Detection(0, 1, "bush", confidence, 0, 0, 9, 9, 1, x, 0.0, 0.0)


def test_the_summary_has_the_keys_of_the_interface_in_its_order():
    summary = leg().summary("meadow", "dwa", Perception.LIDAR, 7, Status.TIMEOUT, 12.0)
    assert list(summary) == KEYS
    assert summary["success"] is False and summary["execution_time_s"] == 10.0
    assert summary["straight_line_m"] == 5.0
    assert summary["exposed_s"] == summary["detection_probability"] == 0.0
    assert summary["policy"] is summary["expected_detection_s"] is None


def test_only_reached_is_a_success():
    for status in Status:
        summary = leg().summary("meadow", "dwa", Perception.ORACLE, 0, status, 3.0)
        assert summary["success"] is (status is Status.REACHED)


def test_commands_out_of_reach_are_counted_but_stops_are_not():
    drive = leg()
    for command in (Twist(0.3, 0.6), Twist(-0.3, -0.6), Twist(0.31, 0.0), Twist(0.0, -0.61)):
        drive.command(command, Twist())
    drive.command(Twist(), Twist(1.0, 0.0))
    assert drive.dynamic_violations == 2


def test_totals_follow_the_true_path():
    drive = leg()
    drive.add(Pose(3.0, 0.0, 1.2, roll=-0.2), True, 0, 10.0)
    drive.add(Pose(3.0, 4.0, 1.1, pitch=0.1), False, 1, 30.0)
    metrics = drive.metrics
    assert metrics.trajectory_length_m == 7.0
    assert metrics.elevation_gradient_m == pytest.approx(0.3)
    assert (metrics.max_roll, metrics.max_pitch) == (0.2, 0.1)
    assert metrics.cover_fraction == 0.5 and metrics.collisions == 1
    summary = drive.summary("meadow", "dwa", Perception.LIDAR, 0, Status.COLLIDED, 4.0)
    assert summary["planner_ms_p50"] == 20.0
    assert summary["max_roll_deg"] == pytest.approx(math.degrees(0.2))


@pytest.mark.parametrize(
    ("seen", "covered"),
    [((bush(5.0, 0.9),), True), ((bush(5.0, 0.8),), False), ((bush(15.0, 0.9),), False), ((), False)],
)
def test_sensing_counts_what_the_camera_detects(seen, covered):
    assert in_cover(percept(detections=seen)) is covered


def test_the_oracle_counts_all_cover():
    near = CoverEstimate(1, CoverKind.DISABLED_VEHICLE, 4.0, 0.0, 0.0, 2.0, 1.7, 1.0)
    fence = CoverEstimate(2, CoverKind.FENCE, 4.0, 0.0, 0.0, 2.0, 1.7, 1.0)
    assert in_cover(percept(Perception.ORACLE, cover=(near,)))
    assert not in_cover(percept(Perception.ORACLE, cover=(fence,)))


def test_time_allowed_grows_with_the_way():
    assert usual_time_limit(12.0) == 102.0
