"""Manifests: contradictions are refused with their fields."""

from typing import Any

import pytest

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType
from valerie.scene.assets.manifest import Manifest, parse_manifest

DOCUMENT: dict[str, Any] = {
    "name": "yard",
    "extent": [-10, 0, 10, 30],
    "cameras": ["camera-1"],
    "persons": ["scene.person-1"],
    "movable": ["scene.person-1"],
    "parameters": [
        {"path": "scene.person-1.pos.x", "minimum": -5, "maximum": 5, "default": 0},
        {"scene_graph_ref": "scene.person-1.pos.y", "minimum": 0, "maximum": 30, "default": 10},
    ],
}


def changed(**changes: Any) -> dict[str, Any]:
    return {**DOCUMENT, **changes}


def test_type_unit_and_stage_of_a_parameter_follow_from_its_attribute() -> None:
    definition = parse_manifest(DOCUMENT).definition("scene.person-1.pos.x")
    assert (definition.type, definition.unit, definition.affects) == (ParameterType.FLOAT, "m", Affects.GEOMETRY)


def test_persons_stand_on_the_ground_unless_the_manifest_says_otherwise() -> None:
    assert parse_manifest(DOCUMENT).grounded == ("scene.person-1",)
    assert parse_manifest(changed(grounded=[])).grounded == ()


def test_a_manifest_survives_json() -> None:
    manifest = parse_manifest(DOCUMENT)
    assert dict(Manifest.model_validate_json(manifest.model_dump_json())) == dict(manifest)


def test_manifests_are_compared_and_looked_up_without_a_look_at_their_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, again, other = (parse_manifest(document) for document in (DOCUMENT, DOCUMENT, changed(bearing_deg=1.0)))
    assert first == again != other  # remembers what it needs
    assert first.model_copy(update={"bearing_deg": 1.0}) == other

    def compared(self: object, other: object) -> bool:
        raise AssertionError("a hot loop would compare thousands of parameters")

    monkeypatch.setattr(ParameterDefinition, "__eq__", compared)
    assert {first: 1}[again] == 1
    assert other not in {first: 1}


def test_an_unknown_field_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="movable"):
        parse_manifest(changed(moveable=["scene.person-1"]))


def test_every_malformed_field_is_reported() -> None:
    with pytest.raises(InvalidInputs) as caught:
        parse_manifest(changed(bearing_deg="north", extent=[0, 1]))
    assert {problem.field for problem in caught.value.problems} >= {"manifest.bearing_deg"}
    assert any(problem.field.startswith("manifest.extent") for problem in caught.value.problems)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"extent": [10, 0, -10, 30]}, "extent"),
        ({"movable": ["person-1"]}, "movable"),
        ({"movable": ["sensor.lens"]}, "movable"),
        ({"persons": ["scene.person-1", "scene.person-1"]}, "persons.*twice"),
        ({"cameras": ["camera 1"]}, "cameras.0"),
        ({"files": ["street.obj"]}, "files.0"),
        ({"grounded": ["scene.group.person-1"]}, "grounded"),
    ],
)
def test_a_contradiction_names_its_field(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        parse_manifest(changed(**changes))


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ({"path": "scene.sun-1.azimut", "default": 0}, "azimuth"),
        ({"path": "scene.person-1.pos.z", "minimum": 0, "maximum": 1, "default": 0}, "ground"),
        ({"path": "scene.person-1.scale", "affects": "light", "default": 1}, "affects"),
        ({"path": "scene.person-1.scale", "type": "ANGLE", "default": 1}, "type"),
        ({"path": "scene.sun-1.elevation", "minimum": -10, "maximum": 95, "default": 3}, "too wide"),
        ({"path": "scene.camera-1.focal_length_mm", "default": 50}, "too wide"),
    ],
)
def test_a_parameter_that_its_attribute_does_not_allow_is_refused(parameter: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        parse_manifest(changed(parameters=[*DOCUMENT["parameters"], parameter]))


POSE = {"path": "scene.person-1.pose", "choices": ["striding", "still"], "default": "still"}
COLOUR = {"path": "scene.person-1.colour", "choices": ["red"], "default": "red"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gaits": ["striding", "running"]}, "gaits: unknown pose 'running'"),
        ({"training": {"poses": {"stil": 1.0}}}, r"training\.poses: unknown pose 'stil'; did you mean still"),
        ({"training": {"left_out": ["scene.car-1"]}}, r"training\.left_out: unknown movable node"),
        ({"paints": {"blue": {"base_color": [0, 0, 1]}}}, "unknown choice of scene.person-1.colour 'red'; known: blue"),
        ({"paints": {"red": {"base_color": [2, 0, 0]}}}, "paints.red.base_color"),
    ],
)
def test_poses_paints_and_training_rules_have_to_fit_the_parameters(changes: dict[str, Any], words: str) -> None:
    document = changed(parameters=[*DOCUMENT["parameters"], POSE, COLOUR], gaits=["striding"])
    document |= {"paints": {"red": {"base_color": [1, 0, 0]}}, "training": {"poses": {"still": 2.0, "striding": 1.0}}}
    assert parse_manifest(document).paints["red"].base_color == (1.0, 0.0, 0.0)
    with pytest.raises(InvalidInput, match=words):
        parse_manifest({**document, **changes})


def test_a_person_that_varies_in_one_coordinate_only_is_refused() -> None:
    with pytest.raises(InvalidInput, match=r"both pos\.x and pos\.y"):
        parse_manifest(changed(parameters=DOCUMENT["parameters"][:1]))


def test_a_class_that_does_not_exist_is_refused_with_near_matches() -> None:
    with pytest.raises(UnknownName, match="building"):
        parse_manifest(changed(node_classes={"scene.a": "bilding"}))


def test_not_a_number_is_refused() -> None:
    with pytest.raises(InvalidInputs, match="bearing_deg"):
        parse_manifest(changed(bearing_deg=float("nan")))


def test_a_node_below_a_movable_node_is_movable_but_not_one_with_a_longer_number() -> None:
    manifest = parse_manifest(DOCUMENT)
    assert manifest.is_movable("scene.person-1.hat.rot.z")
    assert not manifest.is_movable("scene.person-10.pos.x")
