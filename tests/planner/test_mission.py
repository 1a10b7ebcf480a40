"""The loop: a mission drives, ends for a reason, can be changed while it runs, and can go on elsewhere."""

import hashlib
import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from field import field, thing, ticks

from planner.frames import Perception, Status
from planner.mission import Mission
from scenes.scenario import (
    MovingObstacle,
    Observer,
    Patrol,
    Point,
)


def fingerprint(mission: Mission) -> str:
    digest = hashlib.sha256()
    for frame in mission.frames():
        pose, command = frame.pose, frame.decision.command
        numbers = [frame.time_s, *pose.position, pose.roll, pose.pitch, pose.yaw, command.v, command.w]
        digest.update(np.array(numbers).tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("perception", list(Perception))
def test_a_drive_over_open_ground_reaches_its_goal(mission, perception):
    drive = mission(field(), "least_cost", 0, perception)
    frames = list(drive.frames())
    last = frames[-1]
    assert last.status is Status.REACHED and drive.summary()["success"]
    assert math.hypot(last.pose.x - 5.0, last.pose.y) <= 0.3
    assert all(frame.status is Status.RUNNING for frame in frames[:-1])
    assert [frame.tick for frame in frames] == list(range(1, len(frames) + 1))
    assert np.allclose(np.diff([frame.time_s for frame in frames]), 0.1)
    assert "driving to the goal" in frames[5].message and "reached" in last.message
    assert frames[5].percept.perception is perception


def test_before_the_first_tick_there_is_a_frame_of_the_start(mission):
    frame = mission(field(observers=(Observer(id=4, x=3.0, y=3.0),))).frame
    assert frame.tick == 0 and frame.percept is None
    assert math.hypot(frame.pose.x, frame.pose.y) < 0.05
    assert (frame.observers[0].id, frame.observers[0].x) == (4, 3.0)


def test_a_finished_drive_stays_as_it_is(mission):
    drive = mission(field(goal=(1.0, 0.0)), perception=Perception.ORACLE)
    last = list(drive.frames())[-1]
    assert drive.tick() is last


def test_a_drive_out_of_time_is_a_timeout(mission):
    drive = mission(field(), perception=Perception.ORACLE, time_limit_s=1.0)
    frames = list(drive.frames())
    assert len(frames) == 10 and frames[-1].status is Status.TIMEOUT
    assert drive.summary()["status"] == "timeout"


def test_running_into_something_ends_the_drive(mission):
    drive = mission(field(), perception=Perception.ORACLE)
    ticks(drive, 5)
    pose = drive.frame.pose
    drive.edit(field(cover=(thing(9, x=pose.x + 0.7, y=pose.y, length=0.6, width=0.6, height=0.6),)))
    frames = list(drive.frames())
    assert frames[-1].status is Status.COLLIDED
    assert frames[-1].message == "the robot has run into cover 9"
    assert drive.metrics.collisions == 1
    with pytest.raises(ValueError, match="collided"):
        drive.set_goal(-3.0, 0.0)
    drive.set_pose(-3.0, 0.0, 0.0)
    assert drive.status is Status.RUNNING and drive.metrics.collisions == 0


def test_a_goal_shut_in_is_unreachable(mission):
    walls = [
        thing(i, "building", x=5.0 + 2.6 * math.cos(a), y=2.6 * math.sin(a), yaw=math.degrees(a) - 90.0,
              length=5.5, width=0.8, height=3.0)
        for i, a in enumerate(np.arange(4) * math.pi / 2 + 0.001, 1)
    ]  # fmt: skip
    drive = mission(field(cover=tuple(walls)), perception=Perception.ORACLE)
    assert list(drive.frames())[-1].status is Status.UNREACHABLE


def test_a_person_in_the_way_is_not_run_into(mission):
    walker = MovingObstacle(
        id=1, kind="person", x=2.5, y=3.0, patrol=Patrol(waypoints=(Point(x=2.5, y=-3.0),), speed=1.0)
    )
    drive = mission(field(obstacles=(walker,)))
    frames = list(drive.frames())
    assert frames[-1].status is Status.REACHED
    assert frames[10].obstacles[0].y == pytest.approx(3.0 - frames[10].time_s)
    assert any(frame.percept.moving for frame in frames)


def test_a_new_goal_begins_a_new_leg_from_where_the_robot_is(mission):
    drive = mission(field(goal=(2.0, 0.0)), perception=Perception.ORACLE)
    list(drive.frames())
    drive.set_goal(2.0, 3.0)
    assert drive.status is Status.RUNNING and drive.metrics.trajectory_length_m == 0.0
    assert drive.tick().goal == (2.0, 3.0)
    assert list(drive.frames())[-1].status is Status.REACHED
    assert drive.summary()["straight_line_m"] == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize(
    ("x", "y", "words"), [(99.0, 0.0, "off the map"), (3.0, 3.0, "inside a rock"), (3.0, 3.8, "Husky needs")]
)
def test_a_goal_where_no_husky_can_stand_is_refused_and_nothing_changes(mission, x, y, words):
    rock = thing(1, x=3.0, y=3.0, length=1.5, width=1.5, height=1.0)
    drive = mission(field(cover=(rock,)))
    with pytest.raises(ValueError, match=f"the goal.*{words}"):
        drive.set_goal(x, y)
    assert drive.scenario.goal.x == 5.0 and drive.status is Status.RUNNING


def test_edits_take_effect_at_once_and_leave_the_robot_where_it_is(mission):
    drive = mission(field(), perception=Perception.ORACLE)
    ticks(drive, 4)
    before = drive.frame.pose
    wall = thing(2, "fence", x=3.0, y=0.0, yaw=90.0, length=4.0)
    drive.edit(field(cover=(wall,), observers=(Observer(id=1, x=4.0, y=4.0),)))
    frame = drive.tick()
    assert math.dist(before.position, frame.pose.position) < 0.2
    assert frame.percept.cover[0].object_id == 2 and frame.observers[0].id == 1
    assert np.abs(frame.decision.route[:, 1]).max() > 2.0
    assert list(drive.frames())[-1].status is Status.REACHED


def test_a_changed_goal_in_an_edit_is_driven_to(mission):
    drive = mission(field(), perception=Perception.ORACLE)
    ticks(drive, 4)
    drive.edit(field(goal=(0.0, 4.0)))
    frame = drive.tick()
    assert frame.goal == (0.0, 4.0) and frame.decision.waypoint[1] > 0.3


def test_another_terrain_is_no_edit(mission):
    heights = np.zeros((97, 97))
    heights[0, 0] = 1.0
    with pytest.raises(ValueError, match="terrain differs"):
        mission(field()).edit(field(heights=heights))


def test_the_robot_can_be_put_somewhere_else(mission):
    drive = mission(field(), perception=Perception.ORACLE)
    ticks(drive, 3)
    drive.set_pose(-4.0, 2.0, math.pi / 2)
    assert math.hypot(drive.frame.pose.x + 4.0, drive.frame.pose.y - 2.0) < 0.1
    frame = drive.tick()
    assert math.hypot(frame.pose.x + 4.0, frame.pose.y - 2.0) < 0.1
    assert frame.pose.yaw == pytest.approx(math.pi / 2, abs=0.2)
    with pytest.raises(ValueError, match="the robot's place is off the map"):
        drive.set_pose(50.0, 0.0, 0.0)


def test_what_observers_see_is_told_anew_when_they_change(mission):
    drive = mission(field(observers=(Observer(id=1, x=0.0, y=8.0, yaw=-90.0),)), perception=Perception.ORACLE)
    ticks(drive, 3)
    assert drive.frame.exposure.fraction > 0.0
    drive.edit(drive.scenario.revised(observers=()))
    assert drive.frame.exposure.fraction == 0.0 and drive.frame.observers == ()


def test_method_and_perception_can_be_switched_on_the_way(mission):
    drive = mission(field(), "dwa")
    assert drive.tick().decision.route is None
    drive.set_method("least_cost")
    assert drive.tick().decision.route is not None
    drive.set_perception(Perception.ORACLE)
    assert drive.tick().percept.perception is Perception.ORACLE
    assert drive.summary()["method"] == "least_cost" and drive.summary()["perception"] == "oracle"
    for wrong in (lambda: drive.set_method("teleport"), lambda: drive.set_perception("xray")):
        with pytest.raises(ValueError):
            wrong()


def test_stop_ends_the_drive_and_a_new_goal_goes_on(mission):
    drive = mission(field(), perception=Perception.ORACLE)
    drive.stop()
    assert list(drive.frames()) == [] and drive.summary()["status"] == "stopped"
    drive.set_goal(1.0, 1.0)
    assert list(drive.frames())[-1].status is Status.REACHED


def test_a_decision_holds_for_its_period(mission):
    drive = mission(field(), perception=Perception.ORACLE, decision_period_s=0.3)
    decisions = [frame.decision for frame in ticks(drive, 7)]
    assert [i for i in range(1, 7) if decisions[i] is not decisions[i - 1]] == [3, 6]
    with pytest.raises(ValueError, match="at least"):
        Mission(field(), decision_period_s=0.01)


def test_unknown_methods_are_refused():
    with pytest.raises(ValueError, match="least_cost"):
        Mission(field(), "teleport")


def test_a_snapshot_goes_on_in_another_mission(mission):
    rock = thing(1, x=3.0, y=0.3, length=0.8, width=0.8, height=0.8)
    first = mission(field(cover=(rock,)))
    ticks(first, 20)
    snapshot = pickle.loads(pickle.dumps(first.snapshot()))
    second = mission(field(cover=(rock,)), snapshot=snapshot)
    there, here = first.frame, second.frame
    assert (here.tick, here.time_s) == (20, pytest.approx(there.time_s))
    assert math.dist(here.pose.position, there.pose.position) < 0.05
    assert second.metrics == first.metrics
    frame = second.tick()
    assert (~frame.percept.grid.unknown).sum() >= (~there.percept.grid.unknown).sum() * 0.98
    last = list(second.frames())[-1]
    assert last.status is Status.REACHED and last.time_s > 2.0
    assert second.metrics.trajectory_length_m > 4.5


def test_a_snapshot_does_not_change_with_the_mission_it_was_taken_of(mission):
    drive = mission(field())
    ticks(drive, 3)
    snapshot = drive.snapshot()
    memory = bytes(snapshot.memory)
    ticks(drive, 3)
    assert snapshot.memory == memory and snapshot.tick == 3


SCRIPT = """
import sys
sys.path.insert(0, sys.argv[1])
from test_mission import determined, fingerprint
with determined(sys.argv[2]) as drive:
    print(fingerprint(drive))
"""


def determined(method: str) -> Mission:
    rock = thing(1, x=2.5, y=0.2, length=0.8, width=0.8, height=0.8)
    bush = thing(2, "bush", x=2.0, y=-2.0)
    rows = np.linspace(0.0, 6.0, 97)
    heights = 0.2 * np.sin(rows)[:, None] * np.cos(rows)[None, :]
    return Mission(field(cover=(rock, bush), heights=heights), method, 5, time_limit_s=3.0)


@pytest.mark.parametrize("method", ["least_cost", "dwa"])
def test_the_same_drive_is_the_same_to_the_last_bit_in_another_process(method):
    with determined(method) as drive:
        here = fingerprint(drive)
    command = [sys.executable, "-c", SCRIPT, str(Path(__file__).parent), method]
    there = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[-1]
    assert here == there


def test_another_seed_senses_otherwise(mission):
    scans = [mission(field(), seed=seed).tick().scan_points for seed in (1, 1, 2)]
    assert np.array_equal(scans[0], scans[1]) and not np.array_equal(scans[0], scans[2])
