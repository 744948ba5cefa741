import json
import math
import re
from typing import Any

import pytest

from valerie.errors import InvalidInput
from valerie.loading import MAX_BYTES, load_document


def test_yaml_and_json_of_one_document_are_equal() -> None:
    document = {"name": "a", "vary": [["p1", "HOMOGENEOUS", 1.5, 5, 1e-3]], "on": True, "none": None}
    text = "name: a\nvary: [[p1, HOMOGENEOUS, 1.5, 5, 1e-3]]\n'on': true\nnone: null\n"
    assert load_document(text) == load_document(json.dumps(document)) == load_document(document) == document


def test_scalars_are_read_as_yaml_1_2_reads_them() -> None:
    text = "a: no\nb: 1:30\nc: 2020-01-01\nd: 010\ne: 1e3\nf: .5\ng: '5'\nh: 0x10\ni: 1_000\nj: ~\nk: +3\nl: -0.5\n"
    assert load_document(text) == {
        "a": "no", "b": "1:30", "c": "2020-01-01", "d": 10, "e": 1000.0, "f": 0.5, "g": "5", "h": "0x10", "i": "1_000",
        "j": None, "k": 3, "l": -0.5,
    }  # fmt: skip


def test_flow_style_that_is_no_json_is_yaml() -> None:
    assert load_document("{name: a, vary: [1, 2]}") == {"name": "a", "vary": [1, 2]}


def test_a_byte_order_mark_is_no_part_of_the_document() -> None:
    assert load_document("\ufeffname: a".encode()) == {"name": "a"}


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n"


@pytest.mark.parametrize(
    "source",
    [
        b"name: \xff\xfe", "name: \ud800", "a: 1\na: 2", '{"a": 1, "a": 2}', "a: {b: 1, b: 2}", BOMB, "a: &x 1",
        "a: !!python/object/apply:os.system ['true']", "a: !custom 1", "a: [1", "{", "- 1", "3", "", "a: 1\n---\nb: 2",
        "? [1, 2]\n: 3", "1: a", "a: .nan", "a: .inf", "a: 1e400", "a: 1e13", "a: " + "9" * 5000, '{"a": NaN}',
        '{"a": Infinity}', '{"a": 1e999}', "a: 'x\ty", "a: \x01", '{"a": "\\u0000"}', "name: a\n\tb: c",
    ],
)  # fmt: skip
def test_what_no_spec_needs_is_refused(source: str | bytes) -> None:
    with pytest.raises(InvalidInput):
        load_document(source)


@pytest.mark.parametrize("document", [{"a": math.nan}, {"a": [math.inf]}, {"a": 10**13}, {"a": object()}, {1: 2}])
def test_a_document_that_was_read_elsewhere_meets_the_same_limits(document: Any) -> None:
    with pytest.raises(InvalidInput):
        load_document(document)


@pytest.mark.parametrize("form", ["[" * 100_000, '{"a":' * 100_000, "a: " + "[" * 30 + "]" * 30, "{a: " * 2000])
def test_deep_nesting_is_refused_before_it_is_built(form: str) -> None:
    with pytest.raises(InvalidInput):
        load_document(form)


def test_a_document_nested_as_an_object_is_refused_too() -> None:
    deep: Any = 1
    for _ in range(100):
        deep = [deep]
    with pytest.raises(InvalidInput, match="nested too deeply"):
        load_document({"a": deep})


def test_ten_megabytes_are_refused_by_their_size_alone() -> None:
    with pytest.raises(InvalidInput, match=f"too large; got 10000000 bytes; limit: {MAX_BYTES}"):
        load_document(b"\xff" * 10_000_000)


def test_an_error_names_its_line() -> None:
    with pytest.raises(InvalidInput, match="line 4"):
        load_document("name: a\nvary:\n  - [1, 2\n")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a:\n\tb: 1\n", "spaces indent, not tabs (line 2, column 1)"),
        ("a: @b\n", "text that begins with '@' is quoted (line 1, column 4)"),
        ("name:t\nb: 1\n", "no colon is expected here: a key ends with a colon and a space"),
        ("name: a: b\n", "text with ': ' is quoted (line 1, column 8)"),
        ("a: 1\n b: 2\n", "text with ': ' is quoted (line 2, column 3)"),
        ("a:\n  b: 1\n   c: 2\n", "(line 3, column 5)"),
        ("a: {b: 1}\n  c: 2\n", "this does not fit the lines above: entries of one mapping begin in the same column"),
        ("name: 'it's'\n", "this does not fit the lines above"),
        ("a: {b: 1\nc: 2\n", "the bracket of line 1 is not closed (line 2, column 2)"),
        ("a: [1, 2\n", "the bracket of line 1 is not closed"),
        ("a: [1, 2}\n", "the bracket of line 1 is not closed"),
    ],
)  # fmt: skip
def test_an_error_of_notation_says_what_is_probably_wrong(text: str, expected: str) -> None:
    with pytest.raises(InvalidInput, match=f"^not YAML or JSON: .*{re.escape(expected)}"):
        load_document(text)


def test_an_error_names_its_field() -> None:
    with pytest.raises(InvalidInput) as problem:
        load_document({"blocks": [{"vary": [["p1", "UNIFORM", 0, 1e300]]}]})
    assert problem.value.field == "blocks.0.vary.0.3"


def test_a_seed_may_have_64_bits() -> None:
    assert load_document("seed: 9007199254740993") == {"seed": 9007199254740993}


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "~"])
def test_an_empty_document_is_called_empty(text: str) -> None:
    with pytest.raises(InvalidInput, match="the document is empty"):
        load_document(text)
