import hashlib
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valerie.errors import InvalidInput
from valerie.parameters.assignment import Assignment, DigestPrefix, canonical_json, digest

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


def test_equal_numbers_have_equal_bytes() -> None:
    assert canonical_json({"b": 45.0, "a": -0.0}) == canonical_json({"a": 0, "b": 45}) == b'{"a":0,"b":45}'


def test_large_whole_floats_equal_their_integers() -> None:
    assert canonical_json(float(2**60)) == canonical_json(2**60)


def test_truth_and_one_differ_and_so_do_text_and_number() -> None:
    assert len({canonical_json(True), canonical_json(1), canonical_json("1")}) == 3


def test_numpy_scalars_and_tuples_count_as_what_they_hold() -> None:
    numbers = {"a": (np.float64(45.0), np.int64(3), np.float32(0.5), np.bool_(True))}
    assert canonical_json(numbers) == b'{"a":[45,3,0.5,true]}'


@pytest.mark.parametrize("value", [math.nan, math.inf, {"a": [-math.inf]}, np.float64("nan"), 2**70, {1: 2}, object()])
def test_what_has_no_canonical_form_is_refused(value: object) -> None:
    with pytest.raises(InvalidInput):
        canonical_json(value)


@given(JSON)
def test_canonical_json_reads_back_as_the_same_value(value: Any) -> None:
    try:
        text = canonical_json(value)
    except InvalidInput:
        # Lone surrogates have no UTF-8.
        assert "\\ud" in json.dumps(value)
        return
    assert json.loads(text) == value


def test_a_digest_is_128_bits_of_sha256_over_framed_parts() -> None:
    text = b'{"a":1}'
    assert digest({"a": 1.0}) == hashlib.sha256(b"j7:" + text).hexdigest()[:32]


def test_parts_cannot_be_shifted_into_one_another() -> None:
    digests = {digest("a", "bc"), digest("ab", "c"), digest("abc"), digest(["a", "bc"]), digest(b"abc"), digest()}
    assert len(digests) == 6


def test_a_prefix_gives_the_same_digest_as_all_parts_at_once_and_may_be_used_again() -> None:
    prefix = DigestPrefix("a", {"b": 1})
    longer = prefix.extended("c")
    assert longer.digest("d") == digest("a", {"b": 1}, "c", "d")
    assert prefix.digest("x") == prefix.digest("x") == digest("a", {"b": 1}, "x")


def test_an_assignment_cannot_be_changed() -> None:
    values = {"scene.person-1.pos.x": 1.0}
    assignment = Assignment(0, 0, values)
    values["scene.person-1.pos.x"] = 2.0
    assert assignment.values["scene.person-1.pos.x"] == 1.0
    with pytest.raises(TypeError):
        assignment.values["scene.person-1.pos.x"] = 3.0  # type: ignore[index]
