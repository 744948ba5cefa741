"""Joints of persons against scenes with a known answer."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.rendering import scene_rays
from valerie.rendering.annotations.joints import (
    HIDDEN,
    LIMBS,
    OUTSIDE,
    SELF_HIDDEN,
    VISIBLE,
    Joints,
    measure_joints,
)
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.objects import classified
from valerie.scene.graph.model import JOINTS, Node, Scene, Skeleton
from valerie.scene.graph.transforms import camera_transform, place
from valerie.testing.assets import box_mesh, simple_asset

VIEW = View("camera-1", 320, 180)
PERSON, CAR = 24001, 26001


def with_joints(places: NDArray[np.float64], *, x: float = 0.0, y: float = 10.0, heading: float = 0.0) -> Scene:
    """Return a scene of boxes whose person has a skeleton. Its camera stands at (0, 0, 1) and looks along +y."""
    base = simple_asset().base
    nodes = dict(base.nodes)
    nodes["scene.person-1"] = replace(nodes["scene.person-1"], transform=place(x, y, 0.0, heading))
    body = nodes["scene.person-1.red-coat"]
    figure_: Any = SimpleNamespace(joints=places)
    nodes[body.path] = replace(body, figure=figure_)
    camera = replace(base.cameras["camera-1"], transform=camera_transform((0.0, 0.0, 1.0), 0.0, 0.0, 0.0))
    return replace(base, nodes=nodes, cameras={"camera-1": camera})


def at(point: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.tile(np.array(point), (len(JOINTS), 1))


def truth_of(instance: int, depth: float) -> GroundTruth:
    shape = (VIEW.height, VIEW.width)
    return GroundTruth(
        np.full(shape, 7, np.uint8), np.full(shape, instance, np.uint16), np.full(shape, depth, np.float32), ()
    )


def joints_of(scene: Scene, truth: GroundTruth) -> Joints:
    joints = measure_joints(scene, VIEW, truth)
    assert joints.instances.tolist() == [PERSON]
    return joints


def test_places_follow_the_person_and_the_pinhole_formula() -> None:
    # The joint is 0.3 m to the person's right and 1.4 m up. The person faces the camera from 10 m, so its right is on the left.
    joints = joints_of(with_joints(at((0.3, 0.0, 1.4)), heading=180.0), truth_of(PERSON, 9.9))
    np.testing.assert_allclose(joints.places[0, 0], (-0.3, 10.0, 1.4), atol=1e-6)
    np.testing.assert_allclose(joints.camera_places[0, 0], (-0.3, 0.4, -10.0), atol=1e-6)
    focal = simple_asset().base.cameras["camera-1"].focal_length_mm / 36.0 * VIEW.width
    np.testing.assert_allclose(joints.pixels[0, 0], (160 - focal * 0.03, 90 - focal * 0.04), rtol=1e-5)
    assert joints.known.tolist() == [1]


@pytest.mark.parametrize(
    ("instance", "depth", "expected"),
    [
        (PERSON, 9.9, VISIBLE),  # its own skin, 10 cm in front of the joint
        (PERSON, 9.7, SELF_HIDDEN),  # its own trunk
        (CAR, 6.0, HIDDEN),
        (0, 9.95, HIDDEN),
        (0, 30.0, VISIBLE),  # nothing is in front of it, though the mask has a gap there
    ],
)
def test_a_surface_in_front_of_a_joint_decides_its_visibility(instance: int, depth: float, expected: int) -> None:
    joints = joints_of(with_joints(at((0.0, 0.0, 1.0))), truth_of(instance, depth))
    assert (joints.visibility == expected).all()


@pytest.mark.parametrize("x", [-8.0, 8.0])
def test_a_joint_beyond_the_border_has_a_place_and_is_not_visible(x: float) -> None:
    joints = joints_of(with_joints(at((0.0, 0.0, 1.0)), x=x), truth_of(PERSON, 9.9))
    assert (joints.visibility == OUTSIDE).all()
    assert (joints.pixels[0, 0, 0] < 0) == (x < 0)


def test_a_joint_behind_the_camera_has_no_pixel() -> None:
    joints = joints_of(with_joints(at((0.0, 0.0, 1.0)), y=-3.0), truth_of(PERSON, 9.9))
    assert (joints.visibility == OUTSIDE).all()
    assert np.isnan(joints.pixels).all()
    assert joints.camera_places[0, 0, 2] == pytest.approx(3.0)


def test_a_person_without_a_skeleton_is_reported_without_joints() -> None:
    joints = joints_of(simple_asset().base, truth_of(PERSON, 9.9))
    assert joints.known.tolist() == [0]
    assert np.isnan(joints.places).all()
    assert (joints.visibility == OUTSIDE).all()


def test_limbs_connect_every_joint_except_the_eyes() -> None:
    joined = {joint for limb in LIMBS for joint in limb}
    assert {JOINTS[i] for i in set(range(len(JOINTS))) - joined} == {"left_eye", "right_eye"}


BICYCLE, RIDER = 33001, 25001


def with_cyclist() -> Scene:
    """Return boxes without persons: 4 m in front of the camera, a rider 0.6 m deep with joints all over it, and a bicycle.

    The bicycle is a panel before the lower half of the rider.
    """
    scene = with_joints(at((0.0, 0.0, 1.0)))
    path, low, high = "scene.bicycle-1", (-0.25, -0.3, 0.3), (0.25, 0.3, 1.7)
    skeleton = cast("Skeleton", SimpleNamespace(joints=np.random.default_rng(0).uniform(low, high, (len(JOINTS), 3))))
    nodes = [
        Node(path, place(0.2, 4.0, 0.0, 0.0), (box_mesh((-0.8, -0.5, 0.0), (0.8, -0.4, 0.9), "paint"),)),
        Node(f"{path}.rider-1", np.eye(4), (box_mesh(low, high, "skin"),), skeleton=skeleton),
    ]
    others = {name: node for name, node in scene.nodes.items() if not name.startswith("scene.person-")}
    return replace(scene, nodes=others | classified(nodes, {f"{path}.rider-1": "rider"}, ()))


@pytest.mark.gl
def test_a_riders_joints_are_visible_where_rays_from_the_camera_hit_its_body(truth_pass: TruthPass) -> None:
    scene = with_cyclist()
    truth = truth_pass.truth(scene, VIEW)
    joints = measure_joints(scene, VIEW, truth)
    assert (joints.instances.tolist(), joints.known.tolist()) == ([RIDER], [1])
    triangles, camera = scene_rays.triangles_of(scene), scene.cameras["camera-1"]
    rays = joints.places[0].astype(np.float64) - camera.position
    origins = np.broadcast_to(camera.position, rays.shape)
    hits = triangles.intersector.intersects_first(origins, rays)
    points, indices, _ = triangles.intersector.intersects_location(origins, rays, multiple_hits=False)
    gaps = np.full(len(JOINTS), -np.inf)  # from the first surface to the joint, along the optical axis, +y
    gaps[indices] = joints.places[0, indices, 1] - points[:, 1]
    edges = scene_rays.near_edges(truth.instance_map)
    judged = []
    for k, name in enumerate(JOINTS):
        x, y = joints.pixels[0, k].astype(int)
        if edges[y, x] or abs(gaps[k] - 0.2) < 0.02:
            continue
        own = triangles.instances[hits[k]] == RIDER
        expected = HIDDEN if not own else VISIBLE if gaps[k] <= 0.2 else SELF_HIDDEN
        assert joints.visibility[0, k] == expected, name
        judged.append(expected)
    assert set(judged) == {HIDDEN, VISIBLE, SELF_HIDDEN}
    assert len(judged) > len(JOINTS) / 2


def test_a_rider_without_a_skeleton_is_reported_without_joints() -> None:
    base = simple_asset().base
    box = base.nodes["scene.car-1"].meshes
    nodes = classified([Node("scene.rider-1", place(0, 12), box)], {}, ())
    joints = measure_joints(replace(base, nodes=base.nodes | nodes), VIEW, truth_of(PERSON, 9.9))
    assert joints.instances.tolist() == [PERSON, RIDER]
    assert joints.known.tolist() == [0, 0]
