"""Differences of two specs."""

from __future__ import annotations

from typing import Any

import pytest

from valerie.runs.document.differing import differing
from valerie.runs.resolving.spec import parse

SPEC: dict[str, Any] = {
    "name": "a",
    "asset": "urban-street",
    "vary": [["person-1.pos.x", "HOMOGENEOUS", 1.5, 5.5, 1.0]],
}


@pytest.mark.parametrize(
    ("asset", "differences"),
    [
        ({"name": "urban-street"}, []),
        ({"name": "urban-street", "seed": 7}, [("asset.seed", None, 7)]),
        ("box-street", [("asset.name", "urban-street", "box-street")]),
    ],
)
def test_both_forms_of_an_asset_are_compared_part_by_part(
    asset: str | dict[str, Any], differences: list[tuple[str, Any, Any]]
) -> None:
    assert list(differing(parse(SPEC), parse({**SPEC, "name": "b", "asset": asset}))) == differences


def test_places_are_named_as_people_write_them() -> None:
    other = {
        "name": "b",
        "asset": "urban-street",
        "vary": {"scene.person-1.pos.x": {"homogeneous": {"from": 1.5, "to": 5.5, "step": 2.0}}},
        "constants": {"scene.sun-1.elevation": -4},
    }
    assert list(differing(parse(SPEC), parse(other))) == [
        ("constants.sun-1.elevation", None, -4),
        ("vary.person-1.pos.x.step", 1.0, 2.0),
    ]
    of_block = {**SPEC, "blocks": [{"vary": SPEC["vary"], "constants": {"sun-1.elevation": -4}}]}
    del of_block["vary"]
    assert list(differing(parse(SPEC), parse(of_block))) == [("constants.sun-1.elevation", None, -4)]
    two = {**of_block, "blocks": of_block["blocks"] * 2}
    (block,) = differing(parse(of_block), parse(two))
    assert (block.place, block.here) == ("blocks.1", None)
