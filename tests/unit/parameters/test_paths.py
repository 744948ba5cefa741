import pytest

from valerie.errors import InvalidInput
from valerie.parameters.paths import attribute_of, node_of, parse_path, short_name


@pytest.mark.parametrize(
    ("path", "node", "attribute"),
    [
        ("scene.person-1.pos.x", "scene.person-1", "pos.x"),
        ("scene.person-1.heading", "scene.person-1", "heading"),
        ("scene.car-3.door-1.rot.z", "scene.car-3.door-1", "rot.z"),
        ("scene.person-1.cloth.specular_tint", "scene.person-1", "cloth.specular_tint"),
        ("scene.environment.turbidity", "scene.environment", "turbidity"),
        ("scene.kiosk.pos.x", "scene.kiosk", "pos.x"),
        ("sensor.exposure_ev", "sensor", "exposure_ev"),
        ("sensor.noise.sigma", "sensor", "noise.sigma"),
    ],
)
def test_a_path_splits_into_node_and_attribute(path: str, node: str, attribute: str) -> None:
    assert (node_of(path), attribute_of(path)) == (node, attribute)


@pytest.mark.parametrize(
    "path",
    ["", "person-1.pos.x", "scene", "scene.", "scene..x", "scene.1car.x", "scene.a b.x", "scene.x.", "../scene.x",
     "scene." + "a" * 300],
)  # fmt: skip
def test_a_malformed_path_is_refused(path: str) -> None:
    with pytest.raises(InvalidInput):
        parse_path(path)


def test_the_short_name_leaves_out_the_root_scene_only() -> None:
    assert short_name("scene.person-1.pos.x") == "person-1.pos.x"
    assert short_name("sensor.gamma") == "sensor.gamma"
