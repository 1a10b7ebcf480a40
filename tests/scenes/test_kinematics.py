"""The motion model: like the physics in what it can be asked and, within bounds, in what it answers."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small import flat

from scenes.catalogue import Footprint
from scenes.families import generate
from scenes.kinematic_fit import FIRST_SEED, Drive, agreement, fit, record, residuals
from scenes.kinematic_kernel import collides, ground_height, slopes
from scenes.kinematics import HUSKY_RESPONSE, KinematicWorld, Outlines, Response
from scenes.pose import Twist
from scenes.robot import HUSKY
from scenes.scenario import CoverObject, Family, MovingObstacle, ObstacleKind, Patrol, Point, Start
from scenes.stance import standing_pose
from scenes.terrain import Heightmap
from scenes.world import Contact, RobotLostError


def thing(kind: str, x: float, y: float = 0.0, **fields) -> CoverObject:
    return CoverObject.model_validate({"id": 7, "kind": kind, "x": x, "y": y} | fields)


def ramp(slope: float, along_y: bool = False) -> Heightmap:
    ground = flat()
    x, y = ground.xy()
    return Heightmap(slope * (y if along_y else x), ground.resolution, ground.surface, ground.quality)


def drive(world: KinematicWorld, v: float, w: float, seconds: float) -> KinematicWorld:
    for _ in range(round(seconds / 0.25)):
        world.step(Twist(v, w), 0.25)
    return world


@pytest.fixture(scope="module")
def drives() -> list[Drive]:
    """On grounds that the fit has not seen."""
    return [drive for terrain in Family for drive in record(terrain, FIRST_SEED + 50, 4)]


class TestAgreementWithThePhysics:
    @pytest.mark.parametrize(
        ("periods", "place", "place_90", "turn", "turn_90"),
        [(4, 0.06, 0.15, 3.5, 10.0), (10, 0.13, 0.32, 4.0, 12.0)],
        ids=["one second ahead", "two and a half seconds ahead"],
    )
    def test_poses_agree_on_ground_that_the_fit_has_not_seen(
        self, drives, periods, place, place_90, turn, turn_90
    ) -> None:
        error = residuals(drives, HUSKY_RESPONSE, periods)
        away, turned = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
        assert np.median(away) < place and np.percentile(away, 90) < place_90
        assert np.median(turned) < turn and np.percentile(turned, 90) < turn_90

    def test_the_fit_can_be_run_again_and_finds_nearly_the_same(self, drives) -> None:
        begin = Response(0.1, 0.9, 0.9, 0.0, 0.0, 0.0)
        found = fit(drives[::2], begin)
        before, after = (np.abs(residuals(drives[1::2], each, 10)).mean() for each in (begin, found))
        assert after < 0.6 * before
        assert found.yaw_gain == pytest.approx(HUSKY_RESPONSE.yaw_gain, abs=0.05)
        assert found.speed_gain == pytest.approx(HUSKY_RESPONSE.speed_gain, abs=0.05)
        assert agreement(drives, found).count("after 1.0 s") == len(Family)

    def test_pybullet_is_not_needed(self) -> None:
        code = "import sys, scenes.kinematics; sys.exit('pybullet' in sys.modules)"
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


class TestDriving:
    def test_on_level_ground_it_goes_where_it_is_told_within_its_accelerations(self) -> None:
        world = KinematicWorld(flat())
        world.step(Twist(1.0, 0.0), 0.25)
        assert 0.0 < world.pose.x < 0.25 and 0.5 < world.twist.v < 0.8
        drive(world, 1.0, 0.0, 2.0)
        assert world.twist.v == pytest.approx(HUSKY_RESPONSE.speed_gain, abs=1e-3)
        assert world.pose.y == 0.0 and world.time_s == 2.25

    def test_commands_beyond_its_limits_are_cut(self) -> None:
        fast, full = (drive(KinematicWorld(flat()), v, w, 1.0) for v, w in ((9.0, 9.0), (1.0, 1.5)))
        assert fast.pose == full.pose

    def test_in_a_bend_it_slides_outward(self) -> None:
        bend, ideal = (
            drive(KinematicWorld(flat(), response=response), 0.5, 1.0, 1.0)
            for response in (HUSKY_RESPONSE, Response(0.0442, 1.008, 1.023, 0.0, 0.0, 0.0))
        )
        assert bend.pose.x > ideal.pose.x and bend.pose.y < ideal.pose.y

    def test_across_a_slope_it_slides_down_the_more_it_turns(self) -> None:
        straight = drive(KinematicWorld(ramp(0.2, along_y=True)), 0.5, 0.0, 1.0)
        assert straight.pose.y < 0.0
        assert straight.pose.roll == pytest.approx(math.atan(0.2), abs=1e-6)
        turning = drive(KinematicWorld(ramp(0.2, along_y=True)), 0.0, 1.0, 1.0)
        assert turning.pose.y < straight.pose.y

    def test_uphill_it_covers_less_of_the_map(self) -> None:
        level, steep = (drive(KinematicWorld(ground), 0.8, 0.0, 2.0).pose.x for ground in (flat(), ramp(0.3)))
        assert steep == pytest.approx(level / math.hypot(1.0, 0.3), rel=1e-6)

    def test_it_stands_as_its_wheels_do(self) -> None:
        scenario = generate("forest", 5, observers=0)
        world = KinematicWorld(scenario.terrain.heightmap(), start=scenario.start)
        drive(world, 0.6, 0.3, 1.0)
        pose = world.pose
        assert pose == standing_pose(world.heightmap, pose.x, pose.y, pose.yaw)

    def test_too_steep_it_tips_over_and_lies_still(self) -> None:
        world = KinematicWorld(ramp(1.5, along_y=True))
        world.step(Twist(0.1, 0.0), 0.25)
        lying = world.pose
        assert world.up < 0.0
        assert drive(world, 1.0, 0.0, 1.0).pose == lying and world.time_s == 1.25

    def test_wheels_turn_with_the_way_driven(self) -> None:
        ahead, turning = (drive(KinematicWorld(flat()), v, w, 1.0).wheel_angles for v, w in ((1, 0), (0, 1)))
        assert ahead[0] == ahead[1] == ahead[2] == ahead[3] > 0.0
        assert turning[0] == turning[2] < 0.0 < turning[1] == turning[3]

    def test_the_same_commands_give_the_same_bits_however_they_are_cut_up(self) -> None:
        whole, parts = KinematicWorld(ramp(0.1)), KinematicWorld(ramp(0.1))
        whole.step(Twist(0.7, 0.4), 1.0)
        for _ in range(10):
            parts.step(Twist(0.7, 0.4), 0.1)
        assert whole.pose == parts.pose and whole.twist == parts.twist

    def test_the_maps_end_is_the_worlds(self) -> None:
        world = KinematicWorld(flat(), start=Start(x=9.0, y=0.0))
        with pytest.raises(RobotLostError, match="left the world"):
            drive(world, 1.0, 0.0, 3.0)

    @pytest.mark.parametrize("command", [Twist(math.nan, 0.0), Twist(0.0, math.inf)])
    def test_commands_are_numbers(self, command) -> None:
        with pytest.raises(ValueError, match="finite"):
            KinematicWorld(flat()).step(command, 0.1)

    def test_time_goes_forward(self) -> None:
        with pytest.raises(ValueError, match="duration"):
            KinematicWorld(flat()).step(Twist(), 0.0)


class TestRunningIntoThings:
    @pytest.mark.parametrize("kind", ["tree", "bush", "rock", "cottage", "disabled_vehicle", "fence"])
    def test_it_stops_in_front_of_cover_and_says_what_it_touches(self, kind) -> None:
        cover = (thing(kind, 5.0),)
        world = KinematicWorld(flat(), cover)
        for _ in range(40):
            world.step(Twist(1.0, 0.0), 0.25)
            if world.touching():
                break
        assert world.touching() == (Contact("cover", 7),)
        assert world.twist == Twist(0.0, 0.0)
        gap = cover[0].footprint.distance(np.array([[world.pose.x + 0.5 * HUSKY.length, 0.0]]))[0]
        assert gap == pytest.approx(0.0, abs=0.12 if kind == "rock" else 0.05)

    def test_it_drives_between_trunks_and_under_crowns(self) -> None:
        trees = tuple(thing("tree", 3.0, y, length=4.0) for y in (-0.9, 0.9))
        world = drive(KinematicWorld(flat(), trees), 1.0, 0.0, 6.0)
        assert not world.touching() and world.pose.x > 5.0

    def test_somebody_who_walks_is_run_into_where_he_is_then(self) -> None:
        person = MovingObstacle(
            id=3, kind=ObstacleKind.PERSON, x=3.0, y=3.0,
            patrol=Patrol(waypoints=(Point(x=3.0, y=-3.0),), speed=1.0, loop=False),
        )  # fmt: skip
        world = KinematicWorld(flat(), (), (person,))
        drive(world, 1.0, 0.0, 2.0)
        assert not world.touching()
        world.step(Twist(1.0, 0.0), 1.0)
        assert world.touching() == (Contact("obstacle", 3),)
        assert world.time_s == 3.0

    def test_a_touch_is_told_only_for_the_step_it_was_in(self) -> None:
        world = drive(KinematicWorld(flat(), (thing("cottage", 5.0),)), 1.0, 0.0, 4.0)
        assert world.touching()
        world.step(Twist(-0.3, 0.0), 0.25)
        assert not world.touching()

    @pytest.mark.parametrize(
        ("x", "words"), [(math.nan, "finite"), (99.0, "off the map"), (5.0, "inside cottage 7")]
    )
    def test_it_cannot_be_placed_anywhere(self, x, words) -> None:
        world = KinematicWorld(flat(), (thing("cottage", 5.0),))
        with pytest.raises(ValueError, match=words):
            world.place_robot(x, 0.0, 0.0)

    def test_placing_it_forgets_what_it_did(self) -> None:
        world = drive(KinematicWorld(flat(), (thing("cottage", 5.0),)), 1.0, 0.0, 4.0)
        world.place_robot(0.0, 0.0, 0.0)
        fresh = KinematicWorld(flat(), (thing("cottage", 5.0),))
        assert not world.touching() and world.twist == Twist()
        assert drive(world, 0.4, 0.2, 1.0).pose == drive(fresh, 0.4, 0.2, 1.0).pose

    def test_heights_are_numbers(self) -> None:
        with pytest.raises(ValueError, match="not finite"):
            KinematicWorld(flat(height=math.nan))


class TestKernels:
    angles = st.floats(-math.pi, math.pi)
    places = st.floats(-1.5, 1.5)

    @given(places, places, angles, st.floats(0.1, 2.0), st.floats(0.1, 2.0), angles)
    def test_boxes_meet_as_footprints_do(self, x, y, yaw, length, width, turn) -> None:
        robot = Footprint(x, y, yaw, HUSKY.length, HUSKY.width, round=False)
        other = Footprint(0.0, 0.0, turn, length, width, round=False)
        gap = robot.gap(other)
        meets = collides(x, y, yaw, 0.5 * HUSKY.length, 0.5 * HUSKY.width, other.corners, 4, 0.0)
        assert meets == (gap <= 0.0) or abs(gap) < 1e-9

    @given(places, places, angles, st.floats(0.05, 2.0))
    def test_discs_meet_as_footprints_do(self, x, y, yaw, radius) -> None:
        robot = Footprint(x, y, yaw, HUSKY.length, HUSKY.width, round=False)
        gap = robot.gap(Footprint(0.0, 0.0, 0.0, 2.0 * radius, 2.0 * radius, round=True))
        meets = collides(x, y, yaw, 0.5 * HUSKY.length, 0.5 * HUSKY.width, np.zeros((1, 2)), 1, radius)
        assert meets == (gap <= 0.0) or abs(gap) < 1e-9

    @given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
    def test_the_ground_is_the_heightmaps(self, x, y) -> None:
        ground = FOREST
        height = ground_height(ground.heights, ground.resolution, ground.x_min, ground.y_min, x, y)
        assert height == pytest.approx(float(ground.height_at(x, y)), abs=1e-12)

    @given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), angles)
    def test_slopes_are_those_of_a_standing_robot(self, x, y, yaw) -> None:
        ground = FOREST
        pose = standing_pose(ground, x, y, yaw)
        rise, bank = slopes(
            ground.heights, ground.resolution, ground.x_min, ground.y_min, x, y, yaw, 0.256, 0.2854
        )
        assert math.atan(rise) == pytest.approx(-pose.pitch, abs=1e-9)
        assert math.atan(bank * math.cos(pose.pitch)) == pytest.approx(pose.roll, abs=1e-9)

    def test_outlines_can_be_made_once_and_used_again(self) -> None:
        cover = (thing("rock", 5.0),)
        world = KinematicWorld(flat(), cover, outlines=Outlines.of(flat(), cover))
        assert drive(world, 1.0, 0.0, 6.0).touching() == (Contact("cover", 7),)


FOREST = generate("forest", 5, observers=0).terrain.heightmap()
