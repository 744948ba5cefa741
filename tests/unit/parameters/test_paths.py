import pytest

from valerie.errors import InvalidInput
from valerie.parameters.paths import parse_path, short_name


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
