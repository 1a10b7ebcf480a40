import math

import numpy as np
import pytest
from grounds import ground, rough, slope
from hypothesis import given
from hypothesis import strategies as st

from scenes.stance import UNDERSIDE, standing_pose


def test_on_flat_ground_it_stands_level() -> None:
    pose = standing_pose(ground(lambda x, y: 0.0 * x + 2.5), 1.0, -2.0, 0.7)
    assert (pose.x, pose.y, pose.yaw) == (1.0, -2.0, 0.7)
    np.testing.assert_allclose((pose.z, pose.roll, pose.pitch), (2.5, 0.0, 0.0), atol=1e-9)


@pytest.mark.parametrize(
    ("yaw", "pitch", "roll"),
    [(0.0, -20.0, 0.0), (math.pi, 20.0, 0.0), (math.pi / 2, 0.0, -20.0), (-math.pi / 2, 0.0, 20.0)],
    ids=["uphill", "downhill", "hill on the right", "hill on the left"],
)
def test_on_a_slope_it_lies_along_the_ground(yaw: float, pitch: float, roll: float) -> None:
    pose = standing_pose(slope(20.0), 1.0, 0.0, yaw)
    np.testing.assert_allclose(np.degrees((pose.pitch, pose.roll)), (pitch, roll), atol=1e-6)
    np.testing.assert_allclose(pose.z, math.tan(math.radians(20.0)), atol=1e-6)


@given(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-math.pi, math.pi))
def test_no_part_is_in_the_ground_and_some_part_touches_it(x: float, y: float, yaw: float) -> None:
    heightmap = rough(0)
    points = standing_pose(heightmap, x, y, yaw).to_world(UNDERSIDE)
    clearance = points[:, 2] - heightmap.height_at(points[:, 0], points[:, 1])
    assert abs(clearance.min()) < 1e-9
