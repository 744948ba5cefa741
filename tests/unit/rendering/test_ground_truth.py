"""Truth against rays through pixel centres, and its own invariants."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.sampling import enough_to_show
from tests.unit.rendering.scene_rays import assert_agrees, near_edges, trace, triangles_of
from valerie.errors import InvalidInput, UnknownName
from valerie.labels import label_of_node_class
from valerie.rendering.base import View
from valerie.rendering.ground_truth import TruthPass
from valerie.rendering.raster.renderer import RasterRenderer
from valerie.scene.graph.model import Node, Scene
from valerie.scene.graph.transforms import camera_transform
from valerie.scene.variation.variant import apply
from valerie.testing.assets import box_mesh, simple_asset

pytestmark = pytest.mark.gl

VIEW = View("camera-1", 320, 180)
BUILDING = label_of_node_class("building").id


def assert_agrees_with_rays(truth_pass: TruthPass, scene: Scene, view: View) -> None:
    assert_agrees(truth_pass.truth(scene, view), triangles_of(scene), scene.cameras[view.camera], view)


@pytest.mark.parametrize("camera", ["camera-1", "camera-2"])
def test_boxes_agree_with_rays(truth_pass: TruthPass, camera: str) -> None:
    pose = {"scene.person-2.character": "blue-coat", "scene.person-1.heading": 33.0, "scene.person-1.pos.x": 1.2}
    assert_agrees_with_rays(truth_pass, apply(pose, simple_asset()), View(camera, 321, 181))


@given(
    x=st.floats(-6, 6), y=st.floats(0, 40), heading=st.floats(0, 360), roll=st.floats(-30, 30), pitch=st.floats(-20, 20)
)
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_pose_and_camera_agrees_with_rays(
    truth_pass: TruthPass, x: float, y: float, heading: float, roll: float, pitch: float
) -> None:
    scene = apply(
        {"scene.person-1.pos.x": x, "scene.person-1.pos.y": y, "scene.person-1.heading": heading}, simple_asset()
    )
    camera = replace(scene.cameras["camera-1"], transform=camera_transform((0.3, -2, 1.7), 5, pitch, roll))
    assert_agrees_with_rays(truth_pass, replace(scene, cameras={"camera-1": camera}), View("camera-1", 160, 90))


def test_the_amodal_mask_of_a_hidden_person_is_complete(truth_pass: TruthPass) -> None:
    scene = apply({"scene.person-1.pos.x": 2.0, "scene.person-1.pos.y": 12.0}, simple_asset())
    truth = truth_pass.truth(scene, VIEW)
    (person,) = truth.persons
    alone = trace(triangles_of(scene, only_instance=24001), scene.cameras["camera-1"], VIEW)[1] == 24001
    _, instances, _ = assert_agrees(truth, triangles_of(scene), scene.cameras["camera-1"], VIEW)
    assert (instances == 24001).any()
    assert (alone & (instances != 24001)).sum() >= enough_to_show(0.03)
    assert not (person.amodal != alone)[~near_edges(alone)].any()
    assert person.padded_pixels == person.amodal.sum()


def test_pixels_beyond_the_border_count_on_the_padded_canvas(truth_pass: TruthPass) -> None:
    scene = apply({"scene.person-1.pos.x": -3.05, "scene.person-1.pos.y": 4.0}, simple_asset())
    (person,) = truth_pass.truth(scene, VIEW).persons
    # The same person seen by a camera with the same pixels per radian and twice the sensor and image.
    wide = replace(scene.cameras["camera-1"], sensor_width_mm=72.0)
    (whole,) = truth_pass.truth(replace(scene, cameras={"camera-1": wide}), View("camera-1", 640, 360)).persons
    assert 0 < person.amodal.sum() < person.padded_pixels
    # The canvas is padded by half of the image on each side, as the wide image is. Its coordinates are rounded otherwise, which
    # may move a corner's pixel on either side of the person.
    assert abs(person.padded_pixels - int(whole.amodal.sum())) <= 2
    assert abs(int(person.amodal.sum()) - int(whole.amodal[90:270, 160:480].sum())) <= 2


def test_a_person_behind_the_camera_has_no_pixels(truth_pass: TruthPass) -> None:
    scene = simple_asset().base
    camera = replace(scene.cameras["camera-1"], transform=camera_transform((0, -2, 1.5), 180, 0, 0))
    (person,) = truth_pass.truth(replace(scene, cameras={"camera-1": camera}), VIEW).persons
    assert not person.amodal.any()
    assert person.padded_pixels == 0


def test_an_absent_person_is_not_in_the_truth(truth_pass: TruthPass) -> None:
    truth = truth_pass.truth(apply({"scene.person-1.character": "absent"}, simple_asset()), VIEW)
    assert truth.persons == ()
    assert not (truth.class_map == 24).any()


def test_a_person_that_the_manifest_does_not_move_has_its_truth_too(truth_pass: TruthPass) -> None:
    scene = simple_asset().base
    moving = truth_pass.truth(scene, VIEW)
    nodes = {path: replace(node, movable=False) for path, node in scene.nodes.items()}
    standing = truth_pass.truth(replace(scene, nodes=nodes), VIEW)
    np.testing.assert_array_equal(standing.class_map, moving.class_map)
    np.testing.assert_array_equal(standing.persons[0].amodal, moving.persons[0].amodal)


def test_light_and_material_leave_the_truth_alone(truth_pass: TruthPass) -> None:
    first = truth_pass.truth(apply({}, simple_asset()), VIEW)
    other = {"scene.sun-1.elevation": 11.0, "scene.person-1.cloth.roughness": 0.1}
    second = truth_pass.truth(apply(other, simple_asset()), VIEW)
    for name in ("class_map", "instance_map", "depth"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_truth_is_read_only_and_typed(truth_pass: TruthPass) -> None:
    truth = truth_pass.truth(simple_asset().base, VIEW)
    kinds = [array.dtype.name for array in (truth.class_map, truth.instance_map, truth.depth, truth.persons[0].amodal)]
    assert kinds == ["uint8", "uint16", "float32", "bool"]
    assert not any(a.flags.writeable for a in (truth.class_map, truth.instance_map, truth.depth))
    assert truth.class_map.shape == (180, 320)


def test_the_order_of_frames_does_not_matter(truth_pass: TruthPass) -> None:
    asset = simple_asset()
    first = truth_pass.truth(apply({}, asset), VIEW)
    truth_pass.truth(apply({"scene.person-1.pos.x": -4.0}, asset), VIEW)
    truth_pass.truth(apply({}, asset), View("camera-2", 64, 40))
    again = truth_pass.truth(apply({}, asset), VIEW)
    np.testing.assert_array_equal(again.instance_map, first.instance_map)
    np.testing.assert_array_equal(again.depth, first.depth)


def test_an_unknown_camera_is_named(truth_pass: TruthPass) -> None:
    with pytest.raises(UnknownName, match="camera-7"):
        truth_pass.truth(simple_asset().base, View("camera-7", 32, 32))


@pytest.mark.parametrize("width", [0, -3, 100_000])
def test_an_impossible_size_is_refused(truth_pass: TruthPass, width: int) -> None:
    with pytest.raises(InvalidInput, match="width"):
        truth_pass.truth(simple_asset().base, View("camera-1", width, 32))


@given(
    x=st.floats(-6, 6),
    y=st.floats(0, 40),
    second=st.sampled_from(["absent", "red-coat", "blue-coat"]),
    second_x=st.floats(-6, 6),
    camera=st.sampled_from(["camera-1", "camera-2"]),
    elevation=st.floats(5, 85),
)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_ids_depth_and_amodal_masks_are_those_from_scratch_bit_for_bit(
    truth_pass: TruthPass, x: float, y: float, second: str, second_x: float, camera: str, elevation: float
) -> None:
    values = {
        "scene.person-1.pos.x": x,
        "scene.person-1.pos.y": y,
        "scene.person-2.character": second,
        "scene.person-2.pos.x": second_x,
        "scene.sun-1.elevation": elevation,
    }
    scene, view = apply(values, simple_asset()), View(camera, 201, 117)
    cached = truth_pass.truth(scene, view)
    fresh = TruthPass()
    scratch = fresh.truth(scene, view)
    fresh.close()
    for name in ("class_map", "instance_map", "depth"):
        np.testing.assert_array_equal(getattr(cached, name).view(np.uint8), getattr(scratch, name).view(np.uint8))
    assert [p.instance_id for p in cached.persons] == [p.instance_id for p in scratch.persons]
    for person, other in zip(cached.persons, scratch.persons, strict=True):
        np.testing.assert_array_equal(person.amodal, other.amodal)
        assert person.padded_pixels == other.padded_pixels


def test_the_layer_holds_the_changed_pixels_alone_and_the_statics_nothing_that_moves(truth_pass: TruthPass) -> None:
    asset = simple_asset()
    scene = apply({"scene.person-2.character": "blue-coat", "scene.person-2.pos.x": -2.5}, asset)
    (statics, layer), whole = truth_pass.parts(scene, VIEW), truth_pass.truth(scene, VIEW)
    assert not np.isin(statics.instance_map, [24001, 24002]).any()
    assert truth_pass.parts(apply({"scene.person-1.pos.x": 3.0}, asset), VIEW)[0] is statics
    differs = (whole.instance_map != statics.instance_map) | (whole.depth != statics.depth)
    rows, columns = np.nonzero(differs)
    box = layer.rectangle
    assert (box.x, box.y) == (columns.min(), rows.min())
    assert (box.x + box.width, box.y + box.height) == (columns.max() + 1, rows.max() + 1)
    np.testing.assert_array_equal(layer.changed, differs[box.slices])


@pytest.mark.parametrize(("distance", "drawn"), [(598.0, True), (602.0, False)])
def test_surfaces_beyond_600_m_are_sky(
    truth_pass: TruthPass, raster: RasterRenderer, distance: float, drawn: bool
) -> None:
    scene = apply({"scene.person-1.character": "absent"}, simple_asset())
    camera = replace(scene.cameras["camera-1"], transform=camera_transform((0.0, 0.0, 60.0), 0.0, 0.0, 0.0))
    wall = box_mesh((-40.0, distance, 40.0), (40.0, distance + 1.0, 80.0), "plaster")
    nodes = {**scene.nodes, "scene.building-9": Node("scene.building-9", np.eye(4), (wall,), label_id=BUILDING)}
    open_, walled = (replace(scene, nodes=shown, cameras={"camera-1": camera}) for shown in (scene.nodes, nodes))
    truth, middle = truth_pass.truth(walled, VIEW), (VIEW.height // 2, VIEW.width // 2)
    assert (truth.class_map[middle] == BUILDING) is np.bool_(drawn)
    assert np.isfinite(truth.depth[middle]) == drawn
    pictures = [raster.full(seen, VIEW).pixels[middle] for seen in (open_, walled)]
    assert (pictures[0] != pictures[1]).any() == drawn
