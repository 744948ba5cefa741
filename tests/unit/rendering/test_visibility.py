"""Visibility from maps written by hand."""

from dataclasses import replace

import numpy as np
import pytest

from valerie.rendering.base import GroundTruth, PersonTruth, Rectangle, View
from valerie.rendering.visibility import ABSENT, HIDDEN, OUTSIDE, measure, person_roots
from valerie.scene.graph.model import Scene
from valerie.scene.graph.transforms import place
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

VIEW = View("camera-1", 20, 10)
#: The asset's person-1 stands at (0, 10, 0). The camera stands at (0, −2, 1.5) and looks along +y.
SCENE = simple_asset().base


def truth_with(visible: tuple[slice, slice] | None, amodal: tuple[slice, slice] | None, padded: int) -> GroundTruth:
    instances = np.zeros((10, 20), np.uint16)
    mask = np.zeros((10, 20), np.bool_)
    if visible is not None:
        instances[visible] = 24001
    if amodal is not None:
        mask[amodal] = True
    classes = np.where(instances > 0, 24, 7).astype(np.uint8)
    persons = (PersonTruth.of(24001, mask, padded),)
    return GroundTruth(classes, instances, np.ones((10, 20), np.float32), persons)


def test_areas_rates_and_boxes_of_a_partly_hidden_person() -> None:
    truth = truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 9)), 32)
    person = measure(truth, SCENE, VIEW)[0]
    assert (person.pixel_area, person.pixel_area_amodal) == (12, 24)
    assert person.pixel_area_percent == pytest.approx(6.0)
    assert person.occlusion_rate == pytest.approx(0.5)
    assert person.truncation_rate == pytest.approx(0.25)
    assert person.box == Rectangle(5, 2, 2, 6)
    assert person.amodal_box == Rectangle(5, 2, 4, 6)
    assert person.undefined_reason is None


def test_distance_is_euclidean_to_the_ground_origin_and_depth_along_the_axis() -> None:
    person = measure(truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 7)), 12), SCENE, VIEW)[0]
    assert person.distance_m == pytest.approx(np.hypot(12.0, 1.5))
    assert person.depth_m == pytest.approx(12.0)


@pytest.mark.parametrize(
    ("x", "y", "expected"), [(0.0, 10.0, 0.0), (12.0, 10.0, 45.0), (-12.0, 10.0, -45.0), (0.0, -14.0, 180.0)]
)
def test_bearing_is_measured_from_the_axis_and_grows_to_the_right(x: float, y: float, expected: float) -> None:
    # The camera stands at (0, −2, 1.5). At a bearing of ±45°, a person is as far away across as along.
    scene = moved(SCENE, x, y, 0.0)
    person = measure(truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 7)), 12), scene, VIEW)[0]
    assert abs(person.bearing_deg or 0.0) == pytest.approx(abs(expected))
    assert (person.bearing_deg or 0.0) * expected >= 0


@pytest.mark.parametrize(
    ("heading", "expected"), [(180.0, 0.0), (270.0, 90.0), (90.0, -90.0), (0.0, 180.0), (190.0, 10.0)]
)
def test_aspect_is_zero_for_a_person_who_faces_the_camera_and_positive_if_the_right_side_shows(
    heading: float, expected: float
) -> None:
    # From (0, 10) the camera is towards −y, which a heading of 180° faces. A heading of 270° faces +x, right side to the camera.
    scene = moved(SCENE, 0.0, 10.0, heading)
    person = measure(truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 7)), 12), scene, VIEW)[0]
    assert person.aspect_deg is not None
    assert abs((person.aspect_deg - expected + 180) % 360 - 180) < 1e-6


def test_aspect_is_relative_to_the_line_of_sight_and_not_to_the_axis() -> None:
    # At 45° to the right, a person who faces back along the street is seen 45° from the front, with the right side visible.
    scene = moved(SCENE, 12.0, 10.0, 180.0)
    person = measure(truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 7)), 12), scene, VIEW)[0]
    assert person.aspect_deg == pytest.approx(45.0)


def moved(scene: Scene, x: float, y: float, heading: float) -> Scene:
    root = replace(scene.nodes["scene.person-1"], transform=place(x, y, 0.0, heading))
    return replace(scene, nodes={**scene.nodes, root.path: root})


def test_a_fully_hidden_person_has_occlusion_one_and_a_reason() -> None:
    person = measure(truth_with(None, (slice(2, 8), slice(5, 9)), 24), SCENE, VIEW)[0]
    assert person.occlusion_rate == 1.0
    assert person.undefined_reason == HIDDEN
    assert person.box is None
    assert person.amodal_box == Rectangle(5, 2, 4, 6)


def test_a_person_outside_the_image_has_no_occlusion_but_is_truncated() -> None:
    person = measure(truth_with(None, None, 40), SCENE, VIEW)[0]
    assert person.occlusion_rate is None
    assert person.truncation_rate == 1.0
    assert person.undefined_reason == OUTSIDE
    assert person.distance_m is not None


def test_a_person_far_outside_has_no_truncation_either() -> None:
    person = measure(truth_with(None, None, 0), SCENE, VIEW)[0]
    assert person.truncation_rate is None
    assert person.undefined_reason == OUTSIDE


def test_an_absent_person_is_reported_without_a_place() -> None:
    absent = measure(truth_with((slice(2, 8), slice(5, 7)), (slice(2, 8), slice(5, 7)), 12), SCENE, VIEW)[1]
    assert absent.instance_id == 24002
    assert absent.undefined_reason == ABSENT
    assert absent.distance_m is None
    assert absent.occlusion_rate is None


def test_persons_come_by_ascending_instance_id() -> None:
    truth = truth_with(None, None, 0)
    assert [person.instance_id for person in measure(truth, SCENE, VIEW)] == [24001, 24002]


def test_the_ground_origin_moves_with_the_person() -> None:
    scene = apply({"scene.person-1.pos.x": 3.0, "scene.person-1.pos.y": 2.0}, simple_asset())
    person = measure(truth_with(None, None, 0), scene, VIEW)[0]
    assert person.distance_m == pytest.approx(np.sqrt(3**2 + 4**2 + 1.5**2))


def test_the_root_of_a_person_is_its_topmost_node() -> None:
    assert {number: node.path for number, node in person_roots(SCENE).items()} == {
        24001: "scene.person-1",
        24002: "scene.person-2",
    }
