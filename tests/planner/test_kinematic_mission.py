"""A mission takes either world: planning and driving are the same, the physics is left out."""

import pytest
from field import field, thing

from planner.frames import Status
from scenes.kinematics import KinematicWorld


@pytest.mark.parametrize("method", ["dwa", "least_cost"])
def test_a_mission_arrives_in_a_kinematic_world(mission, method) -> None:
    drive = mission(field(goal=(5.0, 0.0), cover=(thing(x=2.5, y=0.3),)), method, world=KinematicWorld)
    frames = list(drive.frames())
    assert drive.status is Status.REACHED
    assert frames[-1].wheel_angles[0] > 0.0 and drive.summary()["collisions"] == 0


def test_editing_goes_on_in_a_kinematic_world(mission) -> None:
    drive = mission(field(goal=(8.0, 0.0)), world=KinematicWorld)
    drive.tick()
    drive.edit(field(goal=(8.0, 0.0), cover=(thing(7, "cottage", x=4.0, y=0.0),)))
    drive.set_method("dwa")
    for _ in range(20):
        drive.tick()
    assert drive.frame.pose.x < 2.5, "it stops for or drives around what was put in its way"
