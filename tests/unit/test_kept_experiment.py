"""docs/experiment: the comparison of engines follows from the kept rows of both."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tools.paper import KEPT, compare_kept
from valerie.analysis.comparison.beside import Beside
from valerie.errors import InvalidInput


def rounded(text: str) -> Any:
    """Read JSON with numbers of ten digits. The last ones depend on the processor, through linear algebra."""
    return json.loads(text, parse_float=lambda number: f"{float(number):.10g}")


def test_the_kept_comparison_of_engines_follows_from_the_kept_rows() -> None:
    kept = (KEPT / "paper-cycles.json").read_text("utf-8")
    assert rounded(json.dumps(compare_kept().to_json())) == rounded(kept)


def test_a_comparison_is_read_back_from_its_file() -> None:
    text = (KEPT / "paper-cycles.json").read_text("utf-8")
    assert json.loads(json.dumps(Beside.from_json(text).to_json())) == json.loads(text)


@pytest.mark.parametrize("text", ["", "[]", '{"here": 1}'])
def test_another_file_is_no_comparison(text: str) -> None:
    with pytest.raises(InvalidInput, match="beside: not a comparison of two runs"):
        Beside.from_json(text)
