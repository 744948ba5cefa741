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
