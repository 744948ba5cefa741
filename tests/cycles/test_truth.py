"""The raster truth pass against Cycles' own object index: poses, cameras, occluders; boxes and the street.

The paper's images and masks came from one engine. Here, truth and image come from different engines, so these tests show that
they are aligned: person masks differ by at most 2 pixels, every other differing pixel lies within a pixel of a silhouette, and
these pixels are at most 1 % of those at silhouettes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from valerie.labels import BY_NAME, SKY
from valerie.rendering.base import View
from valerie.rendering.cycles import translation
from valerie.rendering.cycles.blender import BlenderHolder
from valerie.rendering.cycles.settings import CyclesSettings
from valerie.rendering.ground_truth import TruthPass
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.scene.graph.model import Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

pytestmark = pytest.mark.gl

#: Scenes of the simple asset: free, behind the car, across the border, one person in front of another, on the pavement.
BOXES: tuple[Mapping[str, float | str], ...] = (
    {"scene.person-1.heading": 33.0, "scene.person-1.pos.x": 1.2},
    {"scene.person-1.pos.x": 2.2, "scene.person-1.pos.y": 12.0},
    {"scene.person-1.pos.x": -3.05, "scene.person-1.pos.y": 4.0},
    {"scene.person-2.character": "blue-coat", "scene.person-2.pos.x": 0.2, "scene.person-2.pos.y": 14.0},
    {"scene.person-1.pos.x": 7.0, "scene.person-1.pos.y": 14.0, "scene.person-1.heading": 300.0},
)
#: Scenes of the street: in the open, behind a parked car, far.
STREET: tuple[Mapping[str, float | str], ...] = (
    {"scene.person-1.pos.x": 1.0, "scene.person-1.pos.y": 10.0},
    {"scene.person-1.pos.x": 3.6, "scene.person-1.pos.y": 16.0, "scene.person-1.heading": 90.0},
    {"scene.person-1.pos.x": 0.3, "scene.person-1.pos.y": 30.0},
)
#: Many movables at once: two persons, one partly behind the other, an umbrella and a bag, vehicles in traffic, a rider.
CROWDED: Mapping[str, float | str] = {
    "scene.person-1.character": "striped-boy",
    "scene.person-1.pos.x": 1.6,
    "scene.person-1.pos.y": 14.0,
    "scene.person-1.carries": "umbrella",
    "scene.person-2.character": "red-coat",
    "scene.person-2.pos.x": 1.9,
    "scene.person-2.pos.y": 15.0,
    "scene.person-2.heading": 250.0,
    "scene.car-101.kind": "suv",
    "scene.car-101.pos.y": 26.0,
    "scene.motorcycle-101.visible": True,
    "scene.motorcycle-101.pos.x": -1.0,
    "scene.motorcycle-101.pos.y": 20.0,
}


def traced(holder: BlenderHolder, scene: Scene, view: View) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Return class map and instance map from Cycles' object index."""
    index, items = translation.object_index(holder.get(), scene, view, CyclesSettings().inputs())
    labels = np.array([SKY.id, *(item.node.label_id for item in items)], np.uint8)
    instances = np.array([0, *(item.node.instance_id for item in items)], np.uint16)
    return labels[index], instances[index]


def near_edges(labels: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return the pixels of which one of the eight neighbours has another label."""
    edges: NDArray[np.bool_] = maximum_filter(labels, 3) != minimum_filter(labels, 3)
    return edges


def assert_in_step(holder: BlenderHolder, truth_pass: TruthPass, scene: Scene, view: View) -> None:
    truth = truth_pass.truth(scene, view)
    classes, instances = traced(holder, scene, view)
    assert (instances == 24001).any() == (truth.instance_map == 24001).any()
    for person in truth.persons:
        mask, cycles_mask = truth.instance_map == person.instance_id, instances == person.instance_id
        assert (mask != cycles_mask).sum() <= 2, f"person {person.instance_id}"
    for labels, cycles_labels in ((truth.class_map, classes), (truth.instance_map, instances)):
        silhouettes = near_edges(labels) | near_edges(cycles_labels)
        wrong = labels != cycles_labels
        assert not (wrong & ~silhouettes).any()
        assert wrong.sum() <= 0.01 * silhouettes.sum()  # as stated above


@pytest.mark.parametrize("pose", BOXES)
def test_boxes_are_in_step(holder: BlenderHolder, truth_pass: TruthPass, pose: Mapping[str, float | str]) -> None:
    # The height is even: with an odd one, the middle row looks exactly along the top of the coats, at the camera's height.
    assert_in_step(holder, truth_pass, apply(pose, simple_asset()), View("camera-1", 321, 180))


@pytest.mark.parametrize(("yaw", "pitch", "roll"), [(5, -8, 0), (350, 6, 12), (20, -15, -20)])
def test_any_camera_is_in_step(
    holder: BlenderHolder, truth_pass: TruthPass, yaw: float, pitch: float, roll: float
) -> None:
    scene = apply({"scene.person-1.heading": 60.0}, simple_asset())
    camera = replace(
        scene.cameras["camera-1"], transform=camera_transform((0.3, -2, 1.7), yaw, pitch, roll), focal_length_mm=28.0
    )
    assert_in_step(holder, truth_pass, replace(scene, cameras={"camera-1": camera}), View("camera-1", 240, 180))


@pytest.fixture(scope="module")
def street() -> SceneAsset:
    """Return the street. It is built once, so that equal meshes are sent to Blender once."""
    return load_asset("urban-street")


@pytest.mark.parametrize("pose", STREET)
@pytest.mark.parametrize("camera", ["camera-1", "camera-2"])
def test_the_street_is_in_step(
    holder: BlenderHolder, truth_pass: TruthPass, street: SceneAsset, pose: Mapping[str, float | str], camera: str
) -> None:
    assert_in_step(holder, truth_pass, apply(pose, street), View(camera, 480, 270))


@pytest.mark.parametrize(("yaw", "pitch", "roll"), [(2, -4, 0), (355, -9, 15)])
def test_all_that_moves_is_in_step_for_any_camera_in_the_street(
    holder: BlenderHolder, truth_pass: TruthPass, street: SceneAsset, yaw: float, pitch: float, roll: float
) -> None:
    scene = apply(CROWDED, street)
    moved = camera_transform((1.1, 4.0, 2.3), yaw, pitch, roll)
    camera = replace(scene.cameras["camera-1"], transform=moved, focal_length_mm=32.0)
    scene, view = replace(scene, cameras={"camera-1": camera}), View("camera-1", 480, 270)
    visible = set(np.unique(truth_pass.truth(scene, view).class_map))
    assert {BY_NAME[name].id for name in ("person", "rider", "car", "motorcycle")} <= visible
    assert_in_step(holder, truth_pass, scene, view)
