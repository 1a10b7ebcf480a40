import pytest
from grounds import ground, thing

from scenes.physics import Contact, World
from scenes.pose import Twist
from scenes.scenario import MovingObstacle, Patrol, Point


@pytest.mark.parametrize("kind", ["tree", "bush", "rock", "cottage", "disabled_vehicle", "fence"])
def test_cover_stops_the_robot_and_is_named(kind: str) -> None:
    item = thing(kind, 3.0, 0.0, id=17, yaw=90.0)
    with World(ground(), [item]) as world:
        for _ in range(60):
            world.step(Twist(0.8), 0.1)
            if world.touching():
                break
        assert world.touching() == (Contact("cover", 17),)
        gap = 3.0 - world.pose.x - 0.5 * (item.footprint.width if kind == "fence" else 0.0)
        assert gap > 0.2


def test_the_robot_drives_under_a_crown() -> None:
    tree = thing("tree", 3.0, 1.3, length=4.0, width=4.0, height=7.0)
    with World(ground(), [tree]) as world:
        for _ in range(60):
            world.step(Twist(1.0), 0.1)
            assert world.touching() == ()
        assert world.pose.x > 5.0


def test_a_moving_obstacle_runs_into_a_standing_robot() -> None:
    beat = Patrol(waypoints=(Point(x=-4.0, y=0.0),), speed=1.5)
    person = MovingObstacle(id=3, kind="person", x=4.0, y=0.0, patrol=beat)
    with World(ground(), obstacles=[person]) as world:
        met = None
        while met is None and world.time_s < 4.0:
            world.step(Twist(), 0.1)
            if world.touching():
                met = world.time_s
        assert world.touching() == (Contact("obstacle", 3),)
        assert met == pytest.approx((4.0 - 0.25 - 0.5) / 1.5, abs=0.15)


@pytest.mark.parametrize("kind", ["person", "vehicle"])
def test_what_runs_into_the_robot_at_speed_neither_buries_nor_throws_it(kind: str) -> None:
    beat = Patrol(waypoints=(Point(x=10.0, y=0.0),), speed=10.0)
    with World(ground(), obstacles=[MovingObstacle(id=3, kind=kind, x=-10.0, y=0.1, patrol=beat)]) as world:
        while not world.touching():
            world.step(Twist(), 0.1)
            assert world.time_s < 2.0
        assert abs(world.twist.v) < 12.0
        assert abs(world.pose.z) < 0.3


def test_cover_and_obstacles_are_replaced_while_the_robot_stays() -> None:
    with World(ground()) as world:
        before = world.pose
        world.set_cover([thing("rock", 2.0, 0.0, id=1), thing("tree", 0.0, 5.0, id=2)])
        world.set_obstacles([MovingObstacle(id=1, kind="vehicle", x=-5.0, y=0.0)])
        assert world.pose == before
        world.step(Twist(1.0), 2.0)
        assert world.touching() == (Contact("cover", 1),)
        world.set_cover([thing("tree", 0.0, 5.0, id=2)])
        world.step(Twist(1.0), 2.0)
        assert world.touching() == ()
        assert world.pose.x > 2.0
