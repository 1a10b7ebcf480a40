import numpy as np
from grounds import ground, rough, thing

from scenes.physics import World
from scenes.pose import Pose
from scenes.rays import RayScene
from scenes.scenario import Start
from scenes.sensors import CameraConfig, SemanticCamera


def test_bullets_rays_and_ours_meet_the_same_things() -> None:
    heightmap = rough(8, 60, 70)
    cover = [thing("tree", 3, 1, id=1), thing("cottage", -3, -3, id=2, yaw=30), thing("rock", 0, 4, id=3)]
    rays = np.random.default_rng(0).standard_normal((16384, 3))  # the number at which Bullet loses one
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    eye = np.array([0.5, -0.5, 1.6])
    with World(heightmap, cover, start=Start(x=-6.0, y=5.0), cover_meshes=True) as world:
        distance, body = world.eyes.cast_rays(eye, rays, 25.0)
    hits = RayScene(heightmap, cover).cast(eye, rays, 25.0)
    assert len(distance) == 16384
    points = eye + np.minimum(hits.distance, 25.0)[:, None] * rays
    beside_robot = np.linalg.norm(points - (-6.0, 5.0, 0.2), axis=1)
    clear = (beside_robot > 2.0) & ((rays[:, 2] < -0.1) | (hits.body > 0))  # of the robot and the walls
    assert np.mean(body[clear] == hits.body[clear]) > 0.999
    same = clear & (body == hits.body) & (body >= 0)
    np.testing.assert_allclose(distance[same], hits.distance[same], atol=2e-3)


def test_bullets_renderer_and_our_camera_show_the_same_things() -> None:
    cover = [thing("cottage", 8, 2, id=1, yaw=20), thing("rock", 4, -1, id=2), thing("tree", 9, -4, id=3)]
    lens = CameraConfig(width=160, height=120)
    with World(ground(), cover, start=Start(x=-8.0, y=0.0), cover_meshes=True) as world:
        view = Pose(0.0, 0.0, 0.0).compose(lens.mount)
        depth, body = world.eyes.render_segmentation(view, 160, 120, lens.fov_horizontal, lens.max_range)
    image = SemanticCamera(lens).capture(RayScene(ground(), cover), Pose(0, 0, 0), np.random.default_rng(0))
    assert np.mean(body == image.body) > 0.97
    both = (body == image.body) & (body >= 0)
    assert np.median(np.abs(depth[both] - image.depth[both])) < 0.02
