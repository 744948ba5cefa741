"""What docs/experiment keeps: the comparison of engines follows from the kept rows of both."""

from __future__ import annotations

import json

import pytest

from tools.paper import KEPT, compare_kept
from valerie.analysis.comparison.beside import Beside
from valerie.errors import InvalidInput


def test_the_kept_comparison_of_engines_follows_from_the_kept_rows() -> None:
    kept = json.loads((KEPT / "paper-cycles.json").read_text("utf-8"))
    assert json.loads(json.dumps(compare_kept().to_json())) == kept


def test_a_comparison_is_read_back_from_its_file() -> None:
    text = (KEPT / "paper-cycles.json").read_text("utf-8")
    assert Beside.from_json(text).to_json() == compare_kept().to_json()


@pytest.mark.parametrize("text", ["", "[]", '{"here": 1}'])
def test_another_file_is_no_comparison(text: str) -> None:
    with pytest.raises(InvalidInput, match="beside: not a comparison of two runs"):
        Beside.from_json(text)
