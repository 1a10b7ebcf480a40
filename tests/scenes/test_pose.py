import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scenes.pose import Pose, wrap_angle

ANGLES = st.floats(-math.pi, math.pi)
TILTS = st.floats(-1.5, 1.5)
PLACES = st.floats(-5000.0, 5000.0)
POSES = st.builds(Pose, PLACES, PLACES, PLACES, ANGLES, TILTS, ANGLES)


def test_a_pose_carries_its_body_axes_into_the_world() -> None:
    pose = Pose(1.0, 2.0, 3.0, yaw=math.pi / 2)
    np.testing.assert_allclose(pose.to_world(np.array([[1.0, 0.0, 0.0]])), [[1.0, 3.0, 3.0]], atol=1e-12)
    np.testing.assert_allclose(pose.to_world(np.array([0.0, 1.0, 0.0])), [0.0, 2.0, 3.0], atol=1e-12)


@pytest.mark.parametrize(
    ("pose", "lowered"),
    [(Pose(0, 0, 0, pitch=0.3), "front"), (Pose(0, 0, 0, roll=0.3), "right")],
    ids=["positive pitch lowers the front", "positive roll lowers the right side"],
)
def test_signs_of_tilt(pose: Pose, lowered: str) -> None:
    point = {"front": (1.0, 0.0, 0.0), "right": (0.0, -1.0, 0.0)}[lowered]
    assert pose.to_world(np.array(point))[2] < -0.2


@given(POSES)
def test_a_quaternion_gives_the_same_rotation_back(pose: Pose) -> None:
    again = Pose.from_quaternion(pose.position, pose.quaternion)
    np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_array_equal(again.position, pose.position)


@given(POSES)
def test_rotations_are_those_of_scipy(pose: Pose) -> None:
    expected = Rotation.from_euler("ZYX", [pose.yaw, pose.pitch, pose.roll])
    np.testing.assert_allclose(pose.rotation, expected.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(
        Rotation.from_quat(pose.quaternion).as_matrix(), expected.as_matrix(), atol=1e-12
    )


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("turned", [0.0, 0.7, -2.5])
def test_with_its_nose_straight_up_or_down_the_rotation_is_kept(pitch: float, turned: float) -> None:
    quaternion = Rotation.from_euler("ZYX", [turned, pitch, 0.3]).as_quat()
    again = Pose.from_quaternion((0.0, 0.0, 0.0), quaternion)
    np.testing.assert_allclose(again.rotation, Rotation.from_quat(quaternion).as_matrix(), atol=1e-6)


@given(POSES, POSES, st.tuples(PLACES, PLACES, PLACES))
def test_composing_is_placing_in_turn(pose: Pose, part: Pose, point) -> None:
    point = np.array(point)
    np.testing.assert_allclose(
        pose.compose(part).to_world(point), pose.to_world(part.to_world(point)), atol=1e-6
    )


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.0, 0.0), (math.pi, math.pi), (-math.pi, math.pi), (3 * math.pi, math.pi), (-7.0, 2 * math.pi - 7.0)],
)
def test_angles_wrap_to_above_minus_pi_up_to_pi(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == pytest.approx(wrapped)


def test_arrays_of_angles_wrap() -> None:
    angles = wrap_angle(np.linspace(-20.0, 20.0, 101))
    assert np.all((angles > -np.pi) & (angles <= np.pi))
