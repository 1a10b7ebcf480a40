import math

import numpy as np
import pytest
from grounds import ground, rough, slope, thing
from hypothesis import given
from hypothesis import strategies as st

from scenes.pose import Pose, Twist
from scenes.rays import RayScene
from scenes.robot import HUSKY
from scenes.scenario import MovingObstacle
from scenes.sensors import (
    CameraConfig,
    Lidar,
    LidarConfig,
    Odometry,
    OdometryConfig,
    SemanticCamera,
    cloud_kernel,
)
from scenes.stance import standing_pose
from scenes.terrain import SURFACES, Surface

LEVEL = Pose(0.0, 0.0, 0.0)
EXACT = Lidar(LidarConfig(noise=0.0))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


# --- lidar -------------------------------------------------------------------------------------------


def test_the_lowest_beam_meets_flat_ground_where_geometry_says() -> None:
    cloud = EXACT.scan(RayScene(ground()), LEVEL, rng())
    nearest = np.hypot(cloud.points_body[:, 0], cloud.points_body[:, 1]).min()
    assert nearest == pytest.approx(HUSKY.lidar_mount.z / math.tan(math.radians(15.0)), abs=1e-3)
    assert (cloud.beam[np.hypot(*cloud.points_body[:, :2].T) < nearest + 0.01] == 0).all()
    np.testing.assert_allclose(cloud.points_body[:, 2], 0.0, atol=1e-4)


def test_beams_and_columns_are_the_sensors() -> None:
    lidar = Lidar()
    elevation = np.degrees(np.arcsin(lidar.directions[:16, 2]))
    np.testing.assert_allclose(elevation, np.arange(-15, 16, 2), atol=1e-4)
    azimuth = np.degrees(np.arctan2(lidar.directions[::16, 1], lidar.directions[::16, 0])) % 360.0
    np.testing.assert_allclose(azimuth[1:4], [0.4, 0.8, 1.2], atol=1e-4)
    assert len(Lidar(LidarConfig(azimuths=1800)).directions) == 28_800
    cloud = EXACT.scan(RayScene(rough(0)), LEVEL, rng())
    way = cloud.points_body - HUSKY.lidar_mount.position
    np.testing.assert_allclose(
        way / np.linalg.norm(way, axis=1, keepdims=True),
        lidar.directions[16 * cloud.column + cloud.beam],
        atol=1e-5,
    )


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_points_lie_on_the_ground_whatever_the_robots_pose(yaw: float) -> None:
    heightmap = slope(15.0)
    pose = standing_pose(heightmap, 2.0, -3.0, yaw)
    cloud = EXACT.scan(RayScene(heightmap), pose, rng())
    world = pose.to_world(cloud.points_body)
    np.testing.assert_allclose(world, cloud.in_world(len(world)), atol=1e-4)
    np.testing.assert_allclose(heightmap.height_at(world[:, 0], world[:, 1]), world[:, 2], atol=1e-3)
    sensor = pose.to_world(HUSKY.lidar_mount.position)
    np.testing.assert_allclose(np.linalg.norm(world - sensor, axis=1), cloud.ranges, rtol=1e-5, atol=1e-4)


def test_returns_say_what_they_come_from() -> None:
    rays = RayScene(ground(), [thing("house", 8, 0)])
    rays.set_walkers([MovingObstacle(id=9, kind="person", x=0.0, y=4.0)])
    cloud = EXACT.scan(rays, LEVEL, rng())
    assert set(cloud.body) == {0, 1, 2}
    house, person = cloud.points_body[cloud.body == 1], cloud.points_body[cloud.body == 2]
    assert np.abs(house - (8, 0, 0))[:, :2].max() < 6.0
    assert np.abs(person - (0, 4, 0))[:, :2].max() < 0.5
    assert person[:, 2].max() < 1.8


def test_ranges_end_at_the_sensors_limits() -> None:
    cloud = EXACT.scan(RayScene(ground(resolution=2.5)), LEVEL, rng())
    assert 40.0 < cloud.ranges.max() <= 100.0
    near = Lidar(LidarConfig(noise=0.0, max_range=5.0)).scan(RayScene(ground()), LEVEL, rng())
    assert near.ranges.max() <= 5.0


def test_what_is_too_near_swallows_the_beam() -> None:
    rays = RayScene(
        ground(), [thing("rock", 1.2, 0, length=1.0, width=1.0, height=1.4), thing("house", 9, 0, id=2)]
    )
    cloud = EXACT.scan(rays, LEVEL, rng())
    ahead = (cloud.column == 0) & (cloud.beam == 7)
    assert not ahead.any()
    assert cloud.ranges.min() >= 0.9


def test_from_inside_a_thing_its_inner_walls_are_seen() -> None:
    rays = RayScene(ground(), [thing("building", 0, 0, length=8.0, width=8.0), thing("rock", 10, 0, id=2)])
    cloud = EXACT.scan(rays, LEVEL, rng())
    assert 2 not in cloud.body
    assert cloud.ranges[cloud.body == 1].max() < 7.0


def test_noise_has_its_spread_and_lies_along_the_beam() -> None:
    rays, noisy = RayScene(ground()), Lidar(LidarConfig(noise=0.05))
    exact, cloud = EXACT.scan(rays, LEVEL, rng()), noisy.scan(rays, LEVEL, rng(1))
    error = cloud.ranges - exact.ranges
    assert np.std(error) == pytest.approx(0.05, rel=0.05)
    assert abs(np.mean(error)) < 0.003
    np.testing.assert_allclose(
        cloud.points_body - exact.points_body,
        error[:, None] * EXACT.directions[16 * cloud.column + cloud.beam],
        atol=1e-5,
    )


def test_the_same_seed_gives_the_same_scan_and_another_does_not() -> None:
    rays = RayScene(rough(2), [thing("tree", 4, 0)])
    first, again, other = (Lidar().scan(rays, LEVEL, rng(seed)) for seed in (5, 5, 6))
    assert first.points_body.tobytes() == again.points_body.tobytes()
    assert first.points_body.tobytes() != other.points_body.tobytes()


def test_the_noise_of_a_beam_does_not_depend_on_what_others_hit() -> None:
    empty, full = RayScene(ground()), RayScene(ground(), [thing("house", 6, 0)])
    before, after = Lidar().scan(empty, LEVEL, rng()), Lidar().scan(full, LEVEL, rng())
    behind = {}
    for cloud in (before, after):
        rear = (cloud.column > 300) & (cloud.column < 600)
        behind[id(cloud)] = cloud.points_body[rear].tobytes()
    assert len(set(behind.values())) == 1


# --- camera ------------------------------------------------------------------------------------------


def test_the_image_has_its_top_in_row_0_and_its_left_in_column_0() -> None:
    left, right = thing("house", 9, 5, id=1), thing("cottage", 9, -5, id=2)
    image = SemanticCamera().capture(RayScene(ground(), [left, right]), LEVEL, rng())
    assert image.depth.shape == image.body.shape == (240, 320)
    assert image.rgb.shape == (240, 320, 3)
    assert (image.body[0] != 0).all()
    assert (image.body[-1] == 0).all()
    assert np.nonzero(image.body == 1)[1].mean() < 120 < 200 < np.nonzero(image.body == 2)[1].mean()


def test_depth_is_along_the_optical_axis() -> None:
    wall = thing("building", 10, 0, length=4.0, width=40.0, height=8.0)
    image = SemanticCamera().capture(RayScene(ground(), [wall]), LEVEL, rng())
    depth = image.depth[(image.body == 1)]
    assert np.median(depth) == pytest.approx(10.0 - 2.0 - HUSKY.camera_mount.x, abs=0.1)
    assert np.percentile(depth, 95) - np.percentile(depth, 5) < 0.2


@pytest.mark.parametrize("pose", [LEVEL, Pose(1.0, -2.0, 0.2, 0.1, -0.2, 0.8)])
def test_pixels_and_depth_give_the_points_back(pose: Pose) -> None:
    heightmap = ground(lambda x, y: 0.3 * np.sin(x) - 0.4)
    image = SemanticCamera().capture(RayScene(heightmap), pose, rng())
    rows, columns = np.nonzero(image.body == 0)
    points = pose.to_world(image.points_body(rows, columns))
    np.testing.assert_allclose(heightmap.height_at(points[:, 0], points[:, 1]), points[:, 2], atol=2e-3)


def test_the_field_of_view_is_as_wide_as_it_says() -> None:
    camera = SemanticCamera(CameraConfig(width=321, height=241))
    k = camera.intrinsics
    assert (k.cx, k.cy) == (160.0, 120.0)
    assert k.fx == k.fy
    middle_row = camera.directions.reshape(241, 321, 3)[120]
    span = math.degrees(math.atan2(middle_row[0, 1], middle_row[0, 0])) * 2
    assert span == pytest.approx(87.0, abs=0.3)
    np.testing.assert_allclose(middle_row[160], [1.0, 0.0, 0.0], atol=1e-6)


def test_out_of_range_is_nothing_but_still_has_its_colour() -> None:
    image = SemanticCamera().capture(
        RayScene(ground(rows=300, columns=300), [thing("house", 40, 0)]), LEVEL, rng()
    )
    nothing = image.body < 0
    np.testing.assert_array_equal(nothing, np.isnan(image.depth))
    assert nothing[0].all()
    assert np.nanmax(image.depth) <= 20.0
    assert np.nanmin(image.depth) >= 0.3
    assert (image.class_id[nothing] == -1).all()
    assert (image.surface[nothing] == -1).all()
    assert tuple(image.rgb[0, 0]) == (176, 206, 235)


def test_classes_and_surfaces_are_those_of_what_is_seen() -> None:
    heightmap = ground()
    heightmap.surface[:, 60:] = SURFACES.index(Surface.WATER)  # from x = 3 on
    rays = RayScene(heightmap, [thing("rock", 4, 1, id=5)])
    rays.set_walkers([MovingObstacle(id=1, kind="person", x=4.0, y=-1.0)])
    image = SemanticCamera().capture(rays, LEVEL, rng())
    assert set(image.class_id[image.body == 1]) == {2}
    assert set(image.class_id[image.body == 2]) == {8}
    assert set(image.class_id[image.body == 0]) == {-1}
    grounded = image.surface[image.body == 0]
    assert {SURFACES[index] for index in np.unique(grounded)} == {Surface.GRASS, Surface.WATER}
    assert SURFACES[image.surface[-1, 160]] is Surface.GRASS
    assert (image.surface[image.body != 0] == -1).all()


def test_depth_noise_grows_with_distance_and_is_seeded() -> None:
    rays, noisy = RayScene(ground()), SemanticCamera(CameraConfig(noise=0.002))
    exact, image = SemanticCamera().capture(rays, LEVEL, rng()), noisy.capture(rays, LEVEL, rng(1))
    error = np.abs(image.depth - exact.depth)
    assert np.nanmean(error[exact.depth < 2.0]) < 0.2 * np.nanmean(error[exact.depth > 6.0])
    again = noisy.capture(rays, LEVEL, rng(1))
    assert again.depth.tobytes() == image.depth.tobytes()


# --- odometry ----------------------------------------------------------------------------------------


def drive(odometry: Odometry, seed: int, steps: int = 200) -> list[tuple[Pose, Pose]]:
    """True and estimated poses of a drive round a circle of 20 m."""
    generator = rng(seed)
    pairs = []
    for step in range(steps):
        angle = 2 * math.pi * step / 200
        pose = Pose(3.2 * math.cos(angle), 3.2 * math.sin(angle), 0.1, 0.02, 0.03, angle + math.pi / 2)
        pairs.append((pose, odometry.measure(pose, Twist(1.0, 0.3), generator)[0]))
    return pairs


def test_without_noise_the_robot_knows_its_pose() -> None:
    odometry = Odometry()
    assert all(true == estimate for true, estimate in drive(odometry, 0))
    assert odometry.measure(LEVEL, Twist(0.5, 0.1), rng()) == (LEVEL, Twist(0.5, 0.1))


def test_drift_gathers_with_the_way_driven() -> None:
    config = OdometryConfig(drift=0.05, yaw_drift=0.01)
    errors = np.array(
        [[math.hypot(t.x - e.x, t.y - e.y) for t, e in drive(Odometry(config), seed)] for seed in range(40)]
    )
    assert (errors[:, 0] == 0.0).all()
    spread = np.sqrt(np.mean(errors**2, axis=0))
    assert 0.1 < spread[50] < spread[-1] < 1.5


def test_standing_still_drifts_nowhere() -> None:
    odometry, generator = Odometry(OdometryConfig(drift=0.1, yaw_drift=0.1)), rng()
    for _ in range(50):
        estimate, _ = odometry.measure(LEVEL, Twist(), generator)
    assert estimate == LEVEL


def test_height_and_tilt_are_the_true_ones() -> None:
    for true, estimate in drive(Odometry(OdometryConfig(drift=0.1, yaw_drift=0.1, position_noise=0.1)), 3):
        assert (estimate.z, estimate.roll, estimate.pitch) == (true.z, true.roll, true.pitch)


def test_noise_is_anew_at_every_measurement() -> None:
    config = OdometryConfig(position_noise=0.1, yaw_noise=0.02, speed_noise=0.05, yaw_rate_noise=0.03)
    odometry, generator = Odometry(config), rng()
    measured = [odometry.measure(LEVEL, Twist(), generator) for _ in range(2000)]
    values = np.array([(pose.x, pose.yaw, twist.v, twist.w) for pose, twist in measured])
    np.testing.assert_allclose(values.std(axis=0), [0.1, 0.02, 0.05, 0.03], rtol=0.1)
    np.testing.assert_allclose(values.mean(axis=0), 0.0, atol=0.01)


def test_the_same_seed_drifts_the_same_way_and_reset_forgets() -> None:
    config = OdometryConfig(drift=0.05, yaw_drift=0.02)
    odometry = Odometry(config)
    first = drive(odometry, 7)
    assert drive(Odometry(config), 7) == first
    odometry.reset()
    assert drive(odometry, 7) == first


@given(st.integers(0, 2**32 - 1))
def test_the_clouds_kernel_agrees_with_its_plain_twin(seed: int) -> None:
    draw, beams = rng(seed), 4
    n = beams * int(draw.integers(0, 12))
    distance = draw.uniform(0.0, 5.0, n).astype(np.float32)
    body = draw.integers(-1, 3, n).astype(np.int32)
    noise, directions = draw.normal(0.0, 0.02, n).astype(np.float32), draw.normal(size=(n, 3))
    mount, nearest = np.array([0.1, 0.0, 0.7]), np.float32(0.9)
    met = np.flatnonzero((body >= 0) & (distance >= nearest))
    ranges = distance[met] + noise[met]
    points = (mount + ranges[:, None] * directions[met]).astype(np.float32)
    plain = (points, ranges, body[met], met // beams, met % beams)
    ours = cloud_kernel(distance, body, noise, directions, mount, nearest, beams)
    for mine, theirs in zip(ours, plain, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12)
