import hashlib
import math
import subprocess
import sys

import numpy as np
import pytest
from grounds import ground, rough, slope, thing

from scenes.physics import STEP_S, RobotLostError, World
from scenes.pose import Pose, Twist, wrap_angle
from scenes.scenario import MovingObstacle, Patrol, Point, Start
from scenes.terrain import Heightmap


@pytest.fixture(scope="module")
def flat_world():
    with World(ground()) as world:
        yield world


def driven(world: World, command: Twist, seconds: float) -> np.ndarray:
    """Mean (v, w) over `seconds` of driving."""
    samples = []
    for _ in range(round(60 * seconds)):
        world.step(command, 1 / 60)
        samples.append((world.twist.v, world.twist.w))
    return np.mean(samples, axis=0)


# --- the ground --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "columns"), [(20, 20), (9, 31), (40, 12)])
def test_the_ground_is_the_heightmaps_triangle_by_triangle(rows: int, columns: int) -> None:
    heightmap = rough(1, rows, columns, 0.5)
    west, east, south, north = 0.99 * np.array(heightmap.bounds)  # off the walls
    rng = np.random.default_rng(2)
    x, y = rng.uniform(west, east, 1500), rng.uniform(south, north, 1500)
    with World(heightmap) as world:
        world.place_robot(west + 1.0, south + 1.0, 0.0)
        origins = np.column_stack([x, y, np.full(1500, 5.0)])
        distance, body = world.eyes.cast_rays(origins, np.tile((0.0, 0.0, -1.0), (1500, 1)), 10.0)
    clear = np.hypot(x - west - 1.0, y - south - 1.0) > 1.0  # of the robot
    assert (body[clear] == 0).all()
    np.testing.assert_allclose(5.0 - distance[clear], heightmap.height_at(x, y)[clear], atol=1e-4)


def test_heights_that_are_no_numbers_are_refused() -> None:
    heights = np.zeros((10, 10))
    heights[3, 4] = np.nan
    zeros = np.zeros((10, 10), np.uint8)
    with pytest.raises(ValueError, match="not finite"):
        World(Heightmap(heights, 0.25, zeros, zeros))


def test_walls_keep_the_robot_on_the_map() -> None:
    with World(ground(rows=33, columns=33), start=Start(x=2.5, y=0.0)) as world:
        for yaw in (0.0, math.pi / 2, math.pi, 0.7):
            world.place_robot(2.5 * math.cos(yaw), 2.5 * math.sin(yaw), yaw)
            world.step(Twist(1.0), 3.0)
            assert world.heightmap.contains(world.pose.x, world.pose.y)
            assert world.touching() == ()


def test_a_robot_that_left_the_world_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    with World(ground(rows=33, columns=33)) as world:
        monkeypatch.setattr(World, "pose", property(lambda _: Pose(0.0, 0.0, -3.0)))
        with pytest.raises(RobotLostError, match=r"left the world at \(0.00, 0.00, -3.00\).*0.00 m"):
            world.step(Twist(), 0.1)
        monkeypatch.setattr(World, "pose", property(lambda _: Pose(0.0, 0.0, math.nan)))
        with pytest.raises(RobotLostError, match="no longer a number"):
            world._check_robot()


# --- driving -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [0.0, 0.7])
@pytest.mark.parametrize(
    ("v", "w"),
    [
        (1.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 1.0), (0.0, -1.5), (0.0, 0.3), (1.0, 1.0), (1.0, 1.5),
        (0.5, -0.5), (0.2, 0.2), (-0.3, 0.5),
    ],
)  # fmt: skip
def test_on_flat_ground_it_drives_what_it_is_told(flat_world: World, v: float, w: float, yaw: float) -> None:
    """Within 5 % of v and 10 % of w over two seconds, once it is up to speed."""
    flat_world.place_robot(0.0, 0.0, yaw)
    flat_world.step(Twist(v, w), 0.5)
    mean_v, mean_w = driven(flat_world, Twist(v, w), 2.0)
    assert mean_v == pytest.approx(v, rel=0.05, abs=0.01)
    assert mean_w == pytest.approx(w, rel=0.10, abs=0.01)


def test_it_turns_about_its_middle(flat_world: World) -> None:
    flat_world.place_robot(0.0, 0.0, 0.0)
    for _ in range(30):
        flat_world.step(Twist(0.0, 1.0), 0.1)
        assert math.hypot(flat_world.pose.x, flat_world.pose.y) < 0.08


def test_it_speeds_up_and_stops_within_its_limits(flat_world: World) -> None:
    flat_world.place_robot(0.0, 0.0, 0.0)
    flat_world.step(Twist(1.0), 0.2)
    assert 0.3 < flat_world.twist.v < 0.7  # at 3 m/s²
    flat_world.step(Twist(1.0), 0.8)
    flat_world.step(Twist(0.0), 0.5)
    assert abs(flat_world.twist.v) < 0.03


def test_wheels_turn_as_far_as_the_robot_drives(flat_world: World) -> None:
    flat_world.place_robot(0.0, 0.0, 0.0)
    assert flat_world.wheel_angles == pytest.approx((0.0,) * 4, abs=1e-2)
    flat_world.step(Twist(0.8), 2.0)
    np.testing.assert_allclose(np.multiply(flat_world.wheel_angles, 0.17775), flat_world.pose.x, atol=0.03)
    flat_world.place_robot(0.0, 0.0, 0.0)
    flat_world.step(Twist(0.0, 1.0), 1.0)
    front_left, front_right, rear_left, rear_right = flat_world.wheel_angles
    assert front_left < 0.0 < front_right
    assert rear_left < 0.0 < rear_right


@pytest.mark.parametrize("degrees", [10.0, 20.0])
def test_on_a_slope_it_holds_climbs_crosses_and_turns(degrees: float) -> None:
    with World(slope(degrees)) as world:
        for yaw in (0.0, math.pi / 2, math.pi):
            world.place_robot(0.0, 0.0, yaw)
            begin = world.pose.position
            world.step(Twist(), 2.0)
            assert np.linalg.norm(world.pose.position - begin) < 0.03
            mean_v, _ = driven(world, Twist(0.6), 2.0)
            assert mean_v == pytest.approx(0.6, rel=0.15)  # speeding up included
            assert abs(wrap_angle(world.pose.yaw - yaw)) < 0.1
        world.place_robot(0.0, 0.0, 0.0)
        world.step(Twist(0.0, 0.8), 0.5)
        assert driven(world, Twist(0.0, 0.8), 2.0)[1] == pytest.approx(0.8, rel=0.15)
        assert world.up > 0.9


def test_it_rolls_over_where_the_ground_is_a_cliff() -> None:
    cliff = ground(lambda x, y: np.where(x > 1.0, -3.0, 0.0))
    with World(cliff) as world:
        assert world.up == pytest.approx(1.0, abs=1e-3)
        world.step(Twist(1.0), 4.0)
        assert world.up < 0.8


@pytest.mark.parametrize(
    ("command", "duration", "complaint"),
    [
        (Twist(math.nan, 0.0), 0.1, "v=nan"),
        (Twist(0.0, math.inf), 0.1, "w=inf"),
        (Twist(), 0.0, "duration"),
        (Twist(), math.nan, "duration"),
    ],
)
def test_commands_that_mean_nothing_are_refused(flat_world: World, command, duration, complaint) -> None:
    before = flat_world.pose
    with pytest.raises(ValueError, match=complaint):
        flat_world.step(command, duration)
    assert flat_world.pose == before


@pytest.mark.parametrize(
    ("place", "complaint"),
    [((math.nan, 0.0, 0.0), "finite"), ((0.0, 0.0, math.inf), "finite"), ((500.0, 0.0, 0.0), "off the map")],
)
def test_places_that_are_none_are_refused(flat_world: World, place, complaint) -> None:
    with pytest.raises(ValueError, match=complaint):
        flat_world.place_robot(*place)


def test_the_robot_is_not_placed_inside_cover() -> None:
    with (
        World(ground(rows=49, columns=49), [thing("rock", 3, 0, id=6)]) as world,
        pytest.raises(ValueError, match="inside rock 6"),
    ):
        world.place_robot(3.1, 0.0, 0.0)


def test_time_is_counted_in_whole_steps() -> None:
    with World(ground(rows=33, columns=33), time_s=2.5) as world:
        assert world.time_s == pytest.approx(2.5)
        for _ in range(10):
            world.step(Twist(), 0.1)
        assert world.time_s == pytest.approx(3.5, abs=1e-9)
        assert 240 * STEP_S == 1.0


# --- the same again ----------------------------------------------------------------------------------

COMMANDS = [Twist(0.8, 0.3), Twist(0.2, -1.2), Twist(-0.3, 0.0), Twist(1.0, 1.0)]


def a_drive() -> str:
    """Digest of all poses of a drive over rough ground, into cover and by a walker."""
    beat = Patrol(waypoints=(Point(x=5.0, y=-3.0),), speed=1.0)
    walkers = [MovingObstacle(id=1, kind="person", x=2.0, y=3.0, patrol=beat)]
    cover = [thing("rock", 1.5, 0.2, id=1), thing("tree", -3.0, 1.0, id=2)]
    digest = hashlib.sha256()
    with World(rough(7, 60, 80, relief=0.15), cover, walkers) as world:
        for index in range(24):
            world.step(COMMANDS[index // 6], 0.1)
            pose, twist = world.pose, world.twist
            state = (*pose.position, *pose.quaternion, twist.v, twist.w, *world.wheel_angles)
            digest.update(np.array(state).tobytes())
    return digest.hexdigest()


def test_the_same_commands_give_the_same_bits_again_and_in_another_process() -> None:
    with World(rough(1, 40, 40)) as disturbing:
        first = a_drive()
        disturbing.step(Twist(1.0, 1.0), 0.5)
        second = a_drive()
    code = "import test_physics; print(test_physics.a_drive())"
    elsewhere = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, check=True, env={"PYTHONPATH": ":".join(sys.path)},
    )  # fmt: skip
    assert first == second == elsewhere.stdout.split()[-1]


def test_two_worlds_do_not_disturb_each_other() -> None:
    with World(rough(2)) as alone:
        alone.step(Twist(0.7, 0.4), 1.5)
        expected = alone.pose
    with World(rough(2)) as one, World(slope(15.0), [thing("rock", 2, 0)]) as other:
        for _ in range(15):
            one.step(Twist(0.7, 0.4), 0.1)
            other.step(Twist(1.0, -0.5), 0.1)
        assert one.pose == expected


def test_a_restored_moment_goes_on_to_the_last_bit() -> None:
    beat = Patrol(waypoints=(Point(x=5.0, y=-3.0),), speed=1.0)
    walkers = [MovingObstacle(id=1, kind="person", x=1.0, y=1.0, patrol=beat)]
    with World(rough(3, relief=0.15), [thing("rock", 2.0, 0.0)], walkers) as world:
        world.step(Twist(0.8, 0.2), 1.0)
        moment = world.save()

        def go_on():
            poses = []
            for command in COMMANDS:
                world.step(command, 0.5)
                poses.append((world.pose, world.twist, world.wheel_angles, world.touching(), world.time_s))
            return poses

        first = go_on()
        world.restore(moment)
        assert go_on() == first
        world.place_robot(-3.0, -3.0, 1.0)
        world.restore(moment)
        assert go_on() == first


def test_a_moment_of_another_arrangement_is_refused(flat_world: World) -> None:
    moment = flat_world.save()
    flat_world.set_cover([thing("rock", 4.0, 4.0)])
    with pytest.raises(ValueError, match="have changed"):
        flat_world.restore(moment)
    flat_world.set_cover([])


def test_a_world_closes_once_and_its_moments_may_outlive_it() -> None:
    world = World(ground(rows=33, columns=33))
    moment = world.save()
    world.close()
    world.close()
    del moment
