import math

import numpy as np
import pytest
from cityscapesscripts.helpers import box3dImageTransform
from pyquaternion import Quaternion

from valerie.datasets.camera import camera_document
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform


def _rotation(axis: int, angle: float) -> np.ndarray:
    """About one of the axes, right-handed; written out here so that nothing of the product is used."""
    a, b = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(3)
    matrix[a, a] = matrix[b, b] = math.cos(angle)
    matrix[b, a], matrix[a, b] = math.sin(angle), -math.sin(angle)
    return matrix


@pytest.mark.parametrize("angles", [(0, 0, 0), (20, 0, 0), (0, -7, 0), (0, 0, 5), (350, 4, -3)])
def test_a_point_of_the_world_is_projected_to_the_same_pixel(angles: tuple[float, float, float]) -> None:
    width, height = 960, 540
    camera = Camera("scene.camera-1", camera_transform((2.5, -12.0, 1.4), *angles), 50.0, 36.0)
    point = np.array([1.0, 20.0, 0.9])
    # The scene's own definition: looks along −z, y up.
    local = np.linalg.inv(camera.transform) @ [*point, 1.0]
    focal = 50.0 / 36.0 * width
    expected = (width / 2 - focal * local[0] / local[2] - 0.5, height / 2 + focal * local[1] / local[2] - 0.5)
    # Cityscapes' definition, from the document alone.
    document = camera_document(camera, width, height)
    out, inner = document["extrinsic"], document["intrinsic"]
    rotation = _rotation(2, out["yaw"]) @ _rotation(1, out["pitch"]) @ _rotation(0, out["roll"])
    vehicle = np.array([point[1], -point[0], point[2]])  # x forward, y left
    ahead, left, up = rotation.T @ (vehicle - [out["x"], out["y"], out["z"]])
    projected = (inner["u0"] - inner["fx"] * left / ahead, inner["v0"] - inner["fy"] * up / ahead)
    assert projected == pytest.approx(expected, abs=1e-6)


def test_cityscapes_scripts_project_a_point_of_the_vehicle_to_the_pixel_of_the_scene() -> None:
    width, height = 960, 540
    camera = Camera("scene.camera-1", camera_transform((2.5, -12.0, 1.4), 20.0, -7.0, 5.0), 50.0, 36.0)
    point = np.array([-6.0, 20.0, 0.9])
    local = np.linalg.inv(camera.transform) @ [*point, 1.0]
    focal = 50.0 / 36.0 * width
    expected = (width / 2 - focal * local[0] / local[2] - 0.5, height / 2 + focal * local[1] / local[2] - 0.5)
    document = camera_document(camera, width, height)
    out = document["extrinsic"]
    turns = [((0, 0, 1), out["yaw"]), ((0, 1, 0), out["pitch"]), ((1, 0, 0), out["roll"])]
    yaw, pitch, roll = (Quaternion(axis=axis, angle=angle) for axis, angle in turns)
    to_camera = (yaw * pitch * roll).rotation_matrix.T
    place = -to_camera @ [out["x"], out["y"], out["z"]]
    theirs = box3dImageTransform.Camera(**document["intrinsic"], sensor_T_ISO_8855=np.c_[to_camera, place])
    box = box3dImageTransform.Box3dImageTransform(theirs)
    box.initialize_box((0, 0, 0), Quaternion(), (point[1], -point[0], point[2]))  # a box without extent is a point
    assert 0 < expected[0] < width
    assert 0 < expected[1] < height
    assert box.get_vertices_2d()["BLB"] == pytest.approx(expected, abs=1e-6)


def test_a_camera_that_looks_down_has_a_positive_pitch() -> None:
    camera = Camera("scene.camera-1", camera_transform((0.0, 0.0, 1.4), 0.0, -2.0, 0.0), 50.0)
    assert camera_document(camera, 100, 50)["extrinsic"]["pitch"] == pytest.approx(math.radians(2.0))
