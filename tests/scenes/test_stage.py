"""A scene's world for many drives is each time what a new one would be."""

import math

from grounds import rough, thing

from scenes.physics import World
from scenes.pose import Twist
from scenes.scenario import MovingObstacle, Patrol, Point, Start
from scenes.stage import Stage

GROUND = rough(3, relief=0.15)
COVER = (thing("rock", 2.0, 0.0),)
BEAT = Patrol(waypoints=(Point(x=5.0, y=-3.0),), speed=1.0)
WALKERS = (MovingObstacle(id=1, kind="person", x=1.0, y=1.0, patrol=BEAT),)
START = Start(x=-1.0, y=0.5, yaw=30.0)
COMMANDS = (Twist(0.8, 0.2), Twist(1.0, -0.6), Twist(-0.4, 1.0))


def driven(make, start=START):
    with make(GROUND, COVER, WALKERS, start, time_s=2.0) as world:
        poses = [(world.pose, world.twist, world.wheel_angles, world.touching(), world.time_s)]
        for command in COMMANDS * 3:
            world.step(command, 0.4)
            poses.append((world.pose, world.twist, world.wheel_angles, world.touching(), world.time_s))
    return poses


def test_every_drive_is_to_the_last_bit_that_of_a_new_world():
    alone, stage = driven(World), Stage()
    assert [driven(stage) for _ in range(3)] == [alone] * 3


def test_it_is_one_world_while_the_scene_is_the_same():
    stage = Stage()
    first = stage(GROUND, COVER, WALKERS, START)
    first.close()
    assert stage(GROUND, COVER, WALKERS, START) is first
    elsewhere = Start(x=3.0, y=3.0)
    assert driven(stage, elsewhere) == driven(World, elsewhere), "another start is another scene"
    assert stage(GROUND, COVER, WALKERS, START) is not first


def test_a_world_whose_cover_was_changed_is_not_put_back():
    stage = Stage()
    stage(GROUND, COVER, WALKERS, START, time_s=2.0).set_cover(())
    assert driven(stage) == driven(World)


def test_a_world_that_has_blown_up_is_not_put_back(monkeypatch):
    stage = Stage()
    broken = stage(GROUND, COVER, WALKERS, START, time_s=2.0)
    monkeypatch.setattr(type(broken), "up", math.nan)
    assert stage(GROUND, COVER, WALKERS, START, time_s=2.0) is not broken
