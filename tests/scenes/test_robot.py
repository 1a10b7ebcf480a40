import math

import numpy as np

from scenes.robot import HUSKY, Husky


def test_the_hull_lies_within_the_outer_dimensions() -> None:
    points = HUSKY.hull_points()
    assert points.shape == (12, 3)
    np.testing.assert_allclose(np.abs(points[:, 0]).max(), 0.5 * HUSKY.length)
    np.testing.assert_allclose(np.abs(points[:, 1]).max(), 0.5 * HUSKY.width)
    assert points[:, 2].min() == 0.10
    assert points[:, 2].max() == HUSKY.height


def test_the_circles_hold_the_body_and_are_held_by_it() -> None:
    assert HUSKY.circumscribed_radius == math.hypot(0.495, 0.335)
    assert HUSKY.inscribed_radius == 0.335


def test_dimensions_are_the_manufacturers() -> None:
    assert (Husky().length, Husky().width, Husky().height) == (0.990, 0.670, 0.390)
    assert (Husky().wheelbase, Husky().track) == (0.512, 0.5708)


def test_sensors_look_ahead_from_above_the_body() -> None:
    for mount in (HUSKY.lidar_mount, HUSKY.camera_mount):
        assert mount.z > HUSKY.height
        np.testing.assert_allclose(mount.rotation[:, 0], [1.0, 0.0, 0.0])
