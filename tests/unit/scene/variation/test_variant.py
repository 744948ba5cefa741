"""From assignments to scenes and to the inputs of products, on the small asset of boxes."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.assignment import canonical_json, digest
from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.variation.traverse import traverse
from valerie.scene.variation.variant import apply, complete, split
from valerie.testing.assets import simple_asset

ASSET = simple_asset()
PERSON = "scene.person-1"


def test_defaults_are_taken_where_an_assignment_says_nothing() -> None:
    scene = apply({}, ASSET)
    assert scene.world_transform(PERSON)[:3, 3].tolist() == [0.0, 10.0, 0.0]
    assert scene.nodes[f"{PERSON}.red-coat"].visible
    assert not scene.nodes["scene.person-2"].visible


def test_a_position_moves_the_person_with_everything_below_it() -> None:
    scene = apply({f"{PERSON}.pos.x": -3, f"{PERSON}.pos.y": 7.5}, ASSET)
    assert scene.world_transform(f"{PERSON}.red-coat")[:2, 3].tolist() == [-3.0, 7.5]


@pytest.mark.parametrize(("x", "height"), [(4.9, 0.0), (5.0, 0.25), (12.0, 0.25)])
def test_a_person_stands_on_the_ground_wherever_it_is(x: float, height: float) -> None:
    scene = apply({f"{PERSON}.pos.x": x}, ASSET)
    assert scene.world_transform(PERSON)[2, 3] == height


@pytest.mark.parametrize(("heading", "faces"), [(0, (0, 1)), (90, (-1, 0)), (180, (0, -1)), (360, (0, 1))])
def test_heading_turns_the_person_counter_clockwise(heading: float, faces: tuple[int, int]) -> None:
    scene = apply({f"{PERSON}.heading": heading}, ASSET)
    assert (scene.world_transform(PERSON)[:3, :3] @ [0, 1, 0])[:2].tolist() == list(faces)


def test_a_colour_gives_the_paint_of_a_vehicle_the_look_that_the_manifest_declares() -> None:
    materials = {**ASSET.base.materials, "paint-car": replace(ASSET.base.materials["paint"], name="paint-car")}
    nodes = {
        path: replace(node, meshes=tuple(mesh.with_material("paint-car") for mesh in node.meshes))
        if path.startswith("scene.car-1")
        else node
        for path, node in ASSET.base.nodes.items()
    }
    document = ASSET.manifest.model_dump()
    colour = {"path": "scene.car-1.colour", "choices": ["sand", "red"], "default": "sand"}
    paints = {
        "sand": {"base_color": (0.3, 0.3, 0.2)},
        "red": {"base_color": (0.5, 0.0, 0.0), "metallic": 0.25, "roughness": 0.125},
    }
    manifest = Manifest.model_validate({**document, "parameters": [*document["parameters"], colour], "paints": paints})
    asset = replace(
        ASSET, manifest=manifest, base=replace(ASSET.base, nodes=nodes, materials=materials, paints=manifest.paints)
    )
    assert apply({}, asset).materials["paint-car"].base_color == (0.3, 0.3, 0.2)
    scene = apply({"scene.car-1.colour": "red"}, asset)
    paint = scene.materials["paint-car"]
    assert (paint.base_color, paint.metallic, paint.roughness) == ((0.5, 0.0, 0.0), 0.25, 0.125)
    (row,) = (entry for entry in traverse(asset) if entry.path == "scene.car-1.colour")
    assert (row.value, row.choices) == ("sand", ("sand", "red"))
    (undeclared,) = (entry for entry in traverse(asset) if entry.path == "scene.car-1.door-1.colour")
    assert (undeclared.value, undeclared.choices, undeclared.declared) == ("sand", ("sand", "red"), False)


def test_a_gait_phase_is_an_input_in_poses_with_a_gait_only() -> None:
    document = ASSET.manifest.model_dump()
    pose = {"path": f"{PERSON}.pose", "choices": ["striding", "still"], "default": "striding"}
    phase = {"path": f"{PERSON}.gait_phase", "minimum": 0, "maximum": 1, "default": 0}
    manifest = Manifest.model_validate(
        {**document, "parameters": [*document["parameters"], pose, phase], "gaits": ["striding"]}
    )
    assert complete({f"{PERSON}.gait_phase": 0.5}, manifest)[f"{PERSON}.gait_phase"] == 0.5
    assert f"{PERSON}.gait_phase" not in complete({f"{PERSON}.pose": "still", f"{PERSON}.gait_phase": 0.5}, manifest)


def test_a_character_shows_one_child_and_hides_the_others() -> None:
    scene = apply({f"{PERSON}.character": "blue-coat"}, ASSET)
    assert scene.nodes[f"{PERSON}.blue-coat"].visible
    assert not scene.nodes[f"{PERSON}.red-coat"].visible


def test_an_absent_person_is_hidden_with_everything_below_it() -> None:
    scene = apply({f"{PERSON}.character": "absent"}, ASSET)
    assert not any(node.visible for path, node in scene.nodes.items() if path.startswith(PERSON))


def test_a_person_that_is_absent_by_default_can_appear() -> None:
    scene = apply({"scene.person-2.character": "red-coat"}, ASSET)
    shown = [path for path, node in scene.nodes.items() if path.startswith("scene.person-2") and node.visible]
    assert shown == ["scene.person-2", "scene.person-2.red-coat"]


def test_cloth_changes_only_what_this_person_wears() -> None:
    scene = apply({f"{PERSON}.cloth.metallic": 0.75}, ASSET)
    changed = {
        name for name, m in scene.materials.items() if m is not ASSET.base.materials[name] and m.metallic == 0.75
    }
    assert changed == {"person-1/cloth-red-coat", "person-1/cloth-blue-coat"}
    assert scene.materials["skin"] is ASSET.base.materials["skin"]


def test_the_sun_is_given_in_degrees_and_kept_in_radians() -> None:
    scene = apply({"scene.sun-1.azimuth": 90, "scene.sun-1.elevation": 30, "scene.sun-1.irradiance": 0.5}, ASSET)
    assert (scene.sun.azimuth, scene.sun.elevation, scene.sun.irradiance) == (math.pi / 2, math.radians(30), 0.5)
    np.testing.assert_allclose(scene.sun_direction(), [math.cos(math.radians(30)), 0, 0.5], atol=1e-12)


def test_a_camera_moves_and_zooms_without_touching_the_other() -> None:
    scene = apply({"scene.camera-1.pos.x": 2, "scene.camera-2.focal_length_mm": 70}, ASSET)
    assert scene.cameras["camera-1"].position.tolist() == [2.0, -2.0, 1.5]
    np.testing.assert_array_equal(
        scene.cameras["camera-1"].transform[:3, :3], ASSET.base.cameras["camera-1"].transform[:3, :3]
    )
    assert scene.cameras["camera-2"].focal_length_mm == 70


def test_apply_leaves_the_asset_alone_and_keeps_the_identity_of_untouched_nodes() -> None:
    before = {path: (node, node.transform.copy()) for path, node in ASSET.base.nodes.items()}
    scene = apply({f"{PERSON}.pos.x": 1.5, f"{PERSON}.character": "blue-coat", "scene.sun-1.azimuth": 10}, ASSET)
    for path, (node, transform) in before.items():
        assert ASSET.base.nodes[path] is node
        np.testing.assert_array_equal(node.transform, transform)
        if not path.startswith(PERSON):
            assert scene.nodes[path] is apply({}, ASSET).nodes[path]
        if not node.movable:
            assert scene.nodes[path] is node
        assert scene.nodes[path].meshes is node.meshes


def test_the_result_depends_on_the_values_and_not_on_which_of_them_were_given() -> None:
    short = {f"{PERSON}.pos.x": 3.3, f"{PERSON}.heading": 37.0}
    full = {**complete({}, ASSET.manifest), **short, f"{PERSON}.heading": 397.0}
    one, other = apply(short, ASSET), apply(full, ASSET)
    for path, node in one.nodes.items():
        assert node.transform.tobytes() == other.nodes[path].transform.tobytes()
        assert node.visible == other.nodes[path].visible
    assert one.sun == other.sun
    assert dict(one.materials) == dict(other.materials)


def test_the_pose_of_an_absent_person_changes_no_byte_of_the_scene() -> None:
    variant = apply({f"{PERSON}.character": "absent"}, ASSET)
    other = apply({f"{PERSON}.character": "absent", f"{PERSON}.pos.x": 7, f"{PERSON}.cloth.metallic": 1}, ASSET)
    assert variant.nodes[PERSON].transform.tobytes() == other.nodes[PERSON].transform.tobytes()
    assert dict(variant.materials) == dict(other.materials)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (f"{PERSON}.pos.x", 99.0, "range"),
        (f"{PERSON}.pos.x", "left", "number"),
        (f"{PERSON}.pos.x", float("nan"), "finite"),
        (f"{PERSON}.character", "green-coat", "red-coat"),
    ],
)
def test_a_value_that_is_not_allowed_names_its_path(path: str, value: Value, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        apply({path: value}, ASSET)
    assert path in str(caught.value)


def test_a_path_that_nothing_declares_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match=r"scene\.person-1\.pos\.x"):
        apply({"scene.person-1.pox.x": 1.0}, ASSET)


def test_truth_depends_on_geometry_and_its_own_camera_alone() -> None:
    inputs = split({"scene.sun-1.azimuth": 20, f"{PERSON}.cloth.metallic": 1}, ASSET.manifest, "camera-1")
    assert inputs.geometry == split({}, ASSET.manifest, "camera-1").geometry
    assert set(json.loads(inputs.geometry)) == {
        *(f"{PERSON}.{name}" for name in ("pos.x", "pos.y", "heading", "character")),
        "scene.person-2.character",
        "scene.camera-1.pos.x",
    }


def test_the_background_does_not_depend_on_movable_nodes() -> None:
    moved = {f"{PERSON}.pos.x": 4, f"{PERSON}.character": "absent", "scene.person-2.character": "red-coat"}
    assert split(moved, ASSET.manifest, "camera-2").background == split({}, ASSET.manifest, "camera-2").background
    turned = split({"scene.sun-1.azimuth": 1}, ASSET.manifest, "camera-2").background
    assert json.loads(turned)["scene.sun-1.azimuth"] == 1


def test_the_layer_depends_on_everything_but_the_sensor_and_the_other_camera() -> None:
    layer = json.loads(split({}, ASSET.manifest, "camera-2").layer)
    assert "scene.camera-2.focal_length_mm" in layer
    assert "scene.camera-1.pos.x" not in layer
    assert not any(path.startswith("sensor.") for path in layer)
    assert {f"{PERSON}.cloth.metallic", "scene.sun-1.azimuth", f"{PERSON}.pos.x"} <= set(layer)


def test_the_sensor_takes_its_own_parameters_alone() -> None:
    inputs = split({"sensor.exposure_ev": 1}, ASSET.manifest, "camera-1")
    assert inputs.sensor == {"sensor.exposure_ev": 1.0, "sensor.gamma": 1.0}
    assert inputs.layer == split({}, ASSET.manifest, "camera-1").layer


def test_an_absent_persons_pose_is_no_input_of_anything() -> None:
    hidden = {f"{PERSON}.character": "absent"}
    parts = split(hidden, ASSET.manifest, "camera-1")
    other = split({**hidden, f"{PERSON}.pos.y": 33, f"{PERSON}.cloth.roughness": 0}, ASSET.manifest, "camera-1")
    assert parts == other
    assert parts != split({}, ASSET.manifest, "camera-1")


def test_a_full_turn_is_no_turn() -> None:
    manifest = ASSET.manifest
    assert split({f"{PERSON}.heading": 360}, manifest, "camera-1") == split(
        {f"{PERSON}.heading": 0}, manifest, "camera-1"
    )


@pytest.mark.parametrize(
    "given", [{}, {f"{PERSON}.pos.x": 2.5, f"{PERSON}.pos.y": 3}, {f"{PERSON}.character": "absent"}]
)
def test_inputs_are_the_canonical_json_of_the_complete_assignment(given: dict[str, Value]) -> None:
    values = complete(given, ASSET.manifest)
    inputs = split(given, ASSET.manifest, "camera-1")
    for part in (inputs.geometry, inputs.background, inputs.layer):
        paths = json.loads(part).keys()
        assert part == canonical_json({path: values[path] for path in paths})
        assert digest(part) == digest({path: values[path] for path in paths})


def test_an_unknown_camera_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="camera-1"):
        split({}, ASSET.manifest, "camera-11")
