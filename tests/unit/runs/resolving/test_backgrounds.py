from typing import Any

import pytest

from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.manifest import Manifest

PLACES = {
    "person-1.pos.x": {"homogeneous": {"from": "-2 m", "to": "2 m", "step": "1 m"}},
    "person-1.pos.y": {"homogeneous": {"from": "30 m", "to": "33 m", "step": "1 m"}},
}
SUNS = {"sun-1.azimuth": {"choice": [100, 200]}}
DRAWN = {"sun-1.azimuth": {"uniform": {"from": 90, "to": 270}}}


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ({"vary": PLACES}, True),  # 20 frames share each background
        ({"vary": {**PLACES, **SUNS}}, True),
        ({"vary": SUNS}, False),
        ({"vary": {**PLACES, "sensor.exposure_ev": {"choice": [0, 1, 2]}}}, True),
        ({"vary": {**DRAWN, **PLACES}, "design": "random", "count": 500}, False),
        ({"vary": {**SUNS, **PLACES}, "design": "random", "count": 500}, True),
        ({"vary": {"camera-1.yaw": {"homogeneous": {"from": 0, "to": 9, "step": 1}}}, "cameras": ["camera-1"]}, False),
        ({"vary": SUNS, "infer_backgrounds": True}, True),
        ({"vary": PLACES, "infer_backgrounds": False}, False),
    ],
)
def test_backgrounds_are_inferred_by_default_where_ten_frames_share_one(
    street: Manifest, spec: dict[str, Any], expected: bool
) -> None:
    run = resolve(parse({"name": "one", "asset": "urban-street", **spec}), street, asset_digest="a")
    assert run.infers_backgrounds is expected


def test_the_switch_is_part_of_the_digest(street: Manifest) -> None:
    document = {"name": "one", "asset": "urban-street", "vary": PLACES}
    plain = parse(document)
    assert plain.digest == parse(document | {"infer_backgrounds": None}).digest
    assert plain.digest != parse(document | {"infer_backgrounds": False}).digest
