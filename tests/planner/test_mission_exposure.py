"""A mission counts what its observers see, tick by tick."""

import pickle

import pytest
from field import field, thing, ticks

from planner.frames import Perception
from planner.mission import Mission
from scenes.scenario import Observer, Patrol, Point

ORACLE = Perception.ORACLE
NORTH = Observer(id=7, x=2.0, y=8.0, yaw=-90.0, fov_horizontal=170.0)
BLIND = Observer(id=9, x=2.0, y=-8.0, yaw=90.0, range=0.0)


def test_in_the_open_every_second_is_exposed_and_the_frames_say_so(mission):
    drive = mission(field(observers=(NORTH, BLIND)), "dwa", 0, ORACLE)
    start = drive.frame.exposure
    assert start.fraction == 1.0 and start.exposed_s == 0.0
    frames = list(drive.frames())
    now = frames[-1].exposure
    assert now.exposed_s == pytest.approx(frames[-1].time_s) and now.exposure_fraction == pytest.approx(1.0)
    assert now.longest_exposure_s == pytest.approx(now.exposed_s) and now.concealed_fraction == 0.0
    assert [watch.observer_id for watch in now.watches] == [7, 9]
    assert now.watches[1].exposed_s == 0.0 and now.watches[0].exposed_s == pytest.approx(now.exposed_s)
    summary = drive.summary()
    assert summary["exposed_s"] == now.exposed_s
    assert summary["detection_probability"] == now.detection_probability > 0.5


def test_behind_a_wall_nothing_is_exposed(mission):
    wall = thing(kind="building", x=2.5, y=3.0, length=14.0, width=2.0, height=4.0)
    drive = mission(field(observers=(NORTH,), cover=(wall,)), "dwa", 0, ORACLE)
    assert list(drive.frames())[-1].exposure.exposed_s == 0.0
    assert drive.summary()["concealed_fraction"] == 1.0


def test_an_observer_is_seen_where_it_has_walked_to(mission):
    """It walks out of its range while the robot stands: the fraction follows."""
    walker = Observer(
        id=1, x=0.0, y=4.0, fov_horizontal=360.0, range=6.0,
        patrol=Patrol(waypoints=(Point(x=0.0, y=11.0),), speed=4.0),
    )  # fmt: skip
    drive = mission(field(observers=(walker,)), "dwa", 0, ORACLE, decision_period_s=100.0)
    fractions = [frame.exposure.fraction for frame in ticks(drive, 12)]
    assert fractions[0] == 1.0 and fractions[-1] == 0.0


def test_a_new_goal_begins_a_new_count(mission):
    drive = mission(field(observers=(NORTH,)), "dwa", 0, ORACLE)
    ticks(drive, 20)
    assert drive.frame.exposure.exposed_s == pytest.approx(2.0)
    drive.set_goal(-5.0, 0.0)
    assert drive.tick().exposure.exposed_s == pytest.approx(0.1)


def test_an_observer_put_there_on_the_way_counts_from_then_on(mission):
    drive = mission(field(), "dwa", 0, ORACLE)
    ticks(drive, 10)
    drive.edit(field(observers=(NORTH,)))
    ticks(drive, 10)
    now = drive.frame.exposure
    assert now.exposed_s == pytest.approx(1.0) and now.exposure_fraction == pytest.approx(0.5)


def test_the_count_goes_on_in_another_process(mission):
    drive = mission(field(observers=(NORTH,)), "dwa", 0, ORACLE)
    ticks(drive, 10)
    snapshot = pickle.loads(pickle.dumps(drive.snapshot()))
    again = mission(drive.scenario, "dwa", 0, ORACLE, snapshot=snapshot)
    assert again.frame.exposure == drive.frame.exposure
    assert again.tick().exposure.exposed_s == pytest.approx(1.1)


@pytest.mark.parametrize("perception", list(Perception))
def test_watching_changes_nothing_in_the_drive(mission, monkeypatch, perception):
    scenario = field(observers=(NORTH,), cover=(thing(x=2.5, y=0.3),))

    def poses():
        return [(frame.pose, frame.twist) for frame in ticks(mission(scenario, "dwa", 3, perception), 15)]

    watched = poses()
    monkeypatch.setattr(Mission, "_watch", lambda self, seconds: None)
    assert poses() == watched
