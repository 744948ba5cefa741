"""Rotations and poses against scipy's, camera angles against geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from valerie.scene.graph.transforms import Pose, camera_angles, camera_transform, place, rotation

angles = st.floats(-360, 720)
#: Away from gimbal lock.
tilts = st.floats(-89, 89)


@given(angles, angles, angles)
def test_a_rotation_turns_about_the_fixed_axes_x_y_z_in_this_order(x: float, y: float, z: float) -> None:
    expected = Rotation.from_euler("xyz", [x, y, z], degrees=True).as_matrix()
    np.testing.assert_allclose(rotation(x, y, z), expected, atol=1e-12)


@given(angles, tilts, angles, st.floats(0.1, 10))
def test_a_pose_taken_from_its_matrix_gives_the_same_matrix(x: float, y: float, z: float, scale: float) -> None:
    matrix = Pose((1.0, -2.0, 3.0), (x, y, z), (scale, 2 * scale, scale)).matrix()
    np.testing.assert_allclose(Pose.of(matrix).matrix(), matrix, atol=1e-12)


@given(angles, st.sampled_from([90.0, -90.0]), angles)
def test_a_pose_in_gimbal_lock_still_gives_the_same_matrix(x: float, y: float, z: float) -> None:
    matrix = Pose((0.0, 0.0, 0.0), (x, y, z)).matrix()
    np.testing.assert_allclose(Pose.of(matrix).matrix(), matrix, atol=1e-12)


@pytest.mark.parametrize(
    ("heading", "faces"), [(0, (0, 1)), (90, (-1, 0)), (180, (0, -1)), (270, (1, 0)), (360, (0, 1)), (-90, (1, 0))]
)
def test_heading_zero_faces_plus_y_and_grows_counter_clockwise_exactly(heading: float, faces: tuple[int, int]) -> None:
    matrix = place(5.0, 6.0, 0.5, heading)
    assert (matrix[:3, :3] @ [0, 1, 0]).tolist() == [*faces, 0]
    assert matrix[:3, 3].tolist() == [5.0, 6.0, 0.5]
    assert not np.signbit(matrix[matrix == 0]).any()


def test_a_camera_at_rest_looks_along_plus_y_with_x_to_the_right() -> None:
    world = camera_transform((1.0, 2.0, 3.0), 0, 0, 0)
    assert (world[:3, :3] @ [0, 0, -1]).tolist() == [0, 1, 0]
    assert (world[:3, :3] @ [1, 0, 0]).tolist() == [1, 0, 0]
    assert world[:3, 3].tolist() == [1.0, 2.0, 3.0]


def test_yaw_turns_a_camera_left_pitch_up_and_roll_lowers_its_right_side() -> None:
    assert (camera_transform((0, 0, 0), 30, 0, 0)[:3, :3] @ [0, 0, -1])[0] == pytest.approx(-0.5)
    assert (camera_transform((0, 0, 0), 0, 30, 0)[:3, :3] @ [0, 0, -1])[2] == pytest.approx(0.5)
    assert (camera_transform((0, 0, 0), 0, 0, 30)[:3, :3] @ [1, 0, 0])[2] == pytest.approx(-0.5)


@given(angles, tilts, angles)
def test_camera_angles_are_the_inverse_of_camera_transform(yaw: float, pitch: float, roll: float) -> None:
    world = camera_transform((0.0, 0.0, 0.0), yaw, pitch, roll)
    np.testing.assert_allclose(camera_transform((0.0, 0.0, 0.0), *camera_angles(world)), world, atol=1e-12)


@given(angles, st.sampled_from([90.0, -90.0]), angles)
def test_camera_angles_straight_up_or_down_give_the_same_view(yaw: float, pitch: float, roll: float) -> None:
    world = camera_transform((0.0, 0.0, 0.0), yaw, pitch, roll)
    # At ±90° an arcsine keeps half of the digits: √2⁻⁵² = 1.5e-8.
    np.testing.assert_allclose(camera_transform((0.0, 0.0, 0.0), *camera_angles(world)), world, atol=1e-7)
