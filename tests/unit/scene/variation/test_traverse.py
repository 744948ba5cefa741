"""Every path of an asset, with type, unit, range and value."""

import math
from dataclasses import replace

import pytest

from valerie.parameters.definitions import Affects, ParameterDefinition, ParameterType, Value
from valerie.scene.assets.attributes import ATTRIBUTES, Target, resolve
from valerie.scene.graph.model import Light, Node
from valerie.scene.graph.transforms import Pose
from valerie.scene.variation.traverse import traverse
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

ASSET = simple_asset()
ENTRIES = {entry.path: entry for entry in traverse(ASSET)}


def test_no_path_is_listed_twice() -> None:
    assert len(ENTRIES) == len(traverse(ASSET))


def test_every_declared_parameter_is_listed_with_its_range_and_default() -> None:
    for definition in ASSET.manifest.parameters:
        entry = ENTRIES[definition.path]
        assert entry.declared
        assert (entry.type, entry.unit, entry.affects) == (definition.type, definition.unit, definition.affects)
        assert (entry.minimum, entry.maximum) == (definition.minimum, definition.maximum)
        if "person-2" not in entry.path:
            assert entry.value == definition.default


def test_nested_parts_are_listed_though_nothing_declares_them() -> None:
    entry = ENTRIES["scene.car-1.door-1.rot.z"]
    assert (entry.type, entry.unit, entry.value, entry.declared) == (ParameterType.ANGLE, "deg", 0.0, False)
    assert ENTRIES["scene.car-1.door-1.pos.x"].value == -0.9


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("scene.person-1.heading", 180.0),
        ("scene.person-1.character", "red-coat"),
        ("scene.person-2.character", "absent"),
        ("scene.camera-2.yaw", 345.0),
        ("scene.camera-2.pitch", -5.0),
        ("scene.sun-1.elevation", 45.0),
        ("scene.environment-1.turbidity", 3.0),
        ("sensor.gamma", 1.0),
    ],
)
def test_the_current_value_is_in_the_users_units(path: str, value: Value) -> None:
    assert ENTRIES[path].value == value


def test_every_light_lists_its_colour_strength_and_cone_and_each_can_be_written() -> None:
    light = Light((1.0, 0.5, 0.25), 300.0, math.radians(20), math.radians(60), switch="street")
    pole = Node("scene.pole-1", Pose((1, 2, 5), (270, 0, 0)).matrix(), light=light, label_id=17)
    base = replace(ASSET.base, nodes=dict(ASSET.base.nodes) | {pole.path: pole})
    values = {
        "intensity_cd": 500.0,
        "red": 0.9,
        "green": 0.4,
        "blue": 0.1,
        "inner_deg": 10.0,
        "outer_deg": 50.0,
        "radius_m": 0.2,
    }
    paths = {name: f"scene.pole-1.light.{name}" for name in values}
    definitions = [
        ParameterDefinition(
            path=path, type=ParameterType.FLOAT, unit=ATTRIBUTES[Target.NODE, f"light.{name}"].unit, minimum=0,
            maximum=180 if name.endswith("deg") else 1, default=0.05, affects=Affects.LIGHT,
        )
        for name, path in paths.items()
        if name != "intensity_cd"
    ]  # fmt: skip
    manifest = ASSET.manifest.model_copy(update={"parameters": (*ASSET.manifest.parameters, *definitions)})
    listed = {e.path: e.value for e in traverse(replace(ASSET, base=base))}
    assert listed[paths["intensity_cd"]] == 300.0
    assert listed[paths["green"]] == 0.5
    assert listed[paths["outer_deg"]] == pytest.approx(60.0)
    assert "scene.building-1.light.red" not in ENTRIES
    assignment = {paths[name]: value for name, value in values.items() if name != "intensity_cd"}
    changed = apply(assignment, replace(ASSET, base=base, manifest=manifest)).nodes["scene.pole-1"].light
    assert changed is not None
    assert changed.color == (0.9, 0.4, 0.1)
    assert (changed.inner, changed.outer, changed.radius) == pytest.approx((math.radians(10), math.radians(50), 0.2))
    assert (changed.intensity, changed.switch) == (300.0, "street")


@pytest.mark.parametrize("field", ["street_lamps", "car_lamps"])
def test_a_switch_of_lamps_lists_its_positions(field: str) -> None:
    entry = ENTRIES[f"scene.environment-1.{field}"]
    assert (entry.value, entry.choices) == ("auto", ("auto", "on", "off"))


def test_a_building_faces_nowhere_and_wears_nothing() -> None:
    assert "scene.building-1.heading" not in ENTRIES
    assert "scene.building-1.cloth.metallic" not in ENTRIES
    assert "scene.building-1.character" not in ENTRIES
    assert "scene.car-1.heading" in ENTRIES


def test_a_character_lists_its_choices() -> None:
    assert ENTRIES["scene.person-1.character"].choices == ("red-coat", "blue-coat", "absent")


def test_every_listed_path_resolves_to_its_attribute() -> None:
    for entry in ENTRIES.values():
        thing, attribute = resolve(entry.path, ASSET.manifest.cameras)
        assert f"{thing}.{attribute.name}" == entry.path
        assert attribute.affects is entry.affects


def test_light_is_of_the_light_stage_and_cloth_of_the_material_stage() -> None:
    assert ENTRIES["scene.sun-1.azimuth"].affects is Affects.LIGHT
    assert ENTRIES["scene.person-1.cloth.roughness"].affects is Affects.MATERIAL


def test_the_value_that_is_listed_is_the_one_that_changes_nothing() -> None:
    listed = {entry.path: entry.value for entry in ENTRIES.values() if entry.declared}
    for path, node in apply(listed, ASSET).nodes.items():
        assert (node.transform == apply({}, ASSET).nodes[path].transform).all()
