import hashlib
import json
import struct

import numpy as np
import pytest
from safetensors.numpy import save

from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing.function_file import (
    CLASS_NAMES,
    FORMAT,
    function_file_bytes,
    read_header,
    read_tensors,
)

GIVEN = {"architecture": "any", "mean": (0.1, 0.2, 0.3), "std": (1.0, 2.0, 3.0), "provenance": {"seed": "7"}}
TENSORS = {"b": np.arange(6, dtype=np.float32).reshape(2, 3), "a": np.ones(2, np.float64)}


def entries(**changes: str) -> dict[str, str]:
    whole = {"format": FORMAT, "architecture": "any", "classes": json.dumps(CLASS_NAMES)}
    return whole | {"mean": "[0, 0, 0]", "std": "[1, 1, 1]"} | changes


@pytest.fixture
def write(tmp_path):
    def write_bytes(data: bytes):
        path = tmp_path / "f.safetensors"
        path.write_bytes(data)
        return path

    return write_bytes


def test_a_file_comes_back_as_it_was_written_in_half_precision(write) -> None:
    data = function_file_bytes(TENSORS, **GIVEN)
    path = write(data)
    header = read_header(path)
    assert (header.architecture, header.mean, header.std) == ("any", (0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    assert header.provenance == {"seed": "7"}
    assert header.shapes == {"a": (2,), "b": (2, 3)}
    assert header.digest == hashlib.sha256(data).hexdigest()
    stored = read_tensors(path)
    assert {array.dtype for array in stored.values()} == {np.dtype(np.float16)}
    np.testing.assert_array_equal(stored["b"], TENSORS["b"])


def test_equal_inputs_in_any_order_give_equal_bytes() -> None:
    provenance = {f"fact-{i}": str(i) for i in range(20)}
    file = function_file_bytes(TENSORS, **GIVEN | {"provenance": provenance})
    turned = dict(reversed(TENSORS.items())), dict(reversed(provenance.items()))
    assert function_file_bytes(turned[0], **GIVEN | {"provenance": turned[1]}) == file


def test_values_beyond_half_precision_are_stored_in_single_precision(write) -> None:
    large = {"running_var": np.array([1e5, 0.1], np.float32), "weight": np.array([0.1], np.float32)}
    stored = read_tensors(write(function_file_bytes(large, **GIVEN)))
    assert stored["running_var"].dtype == np.float32
    np.testing.assert_array_equal(stored["running_var"], large["running_var"])
    assert stored["weight"].dtype == np.float16


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused_with_their_name(value: float) -> None:
    with pytest.raises(InvalidInput, match="w: holds values that are not finite"):
        function_file_bytes({"w": np.array([1.0, value])}, **GIVEN)


def test_provenance_cannot_replace_entries_of_the_format() -> None:
    with pytest.raises(InvalidInput, match="mean"):
        function_file_bytes(TENSORS, **GIVEN | {"provenance": {"mean": "x"}})


def test_a_missing_file_is_not_found(tmp_path) -> None:
    with pytest.raises(NotFound, match=r"none\.safetensors"):
        read_header(tmp_path / "none.safetensors")


def test_a_header_that_promises_missing_data_is_refused(write) -> None:
    header = {"__metadata__": entries(), "a": {"dtype": "F16", "shape": [1000], "data_offsets": [0, 2000]}}
    text = json.dumps(header).encode()
    with pytest.raises(InvalidInput, match="not a readable safetensors file"):
        read_header(write(struct.pack("<Q", len(text)) + text + b"\0" * 4))


@pytest.mark.parametrize("data", [b"", b"\x80\x04pickle", b"\xff" * 64, b"PK\x03\x04" + b"\0" * 100])
def test_something_else_is_refused(write, data: bytes) -> None:
    with pytest.raises(InvalidInput, match="not a readable safetensors file"):
        read_header(write(data))


def test_a_cut_file_is_refused(write) -> None:
    with pytest.raises(InvalidInput, match="not a readable"):
        read_header(write(function_file_bytes(TENSORS, **GIVEN)[:-3]))


def test_missing_entries_are_named(write) -> None:
    with pytest.raises(InvalidInput, match="architecture, classes, mean, std"):
        read_header(write(save({"a": np.ones(1, np.float16)}, metadata={"format": FORMAT})))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "valerie-function/9"}, "not the file format of this program"),
        ({"classes": '["cat"]'}, "not the classes"),
        ({"classes": "["}, "not JSON"),
        ({"mean": "[1, 2]"}, "not three numbers"),
        ({"mean": '["a", 1, 2]'}, "not three numbers"),
        ({"mean": "[NaN, 1, 2]"}, "not three numbers"),
        ({"std": "[0, 1, 1]"}, "not three positive numbers"),
    ],
)
def test_a_wrong_entry_is_refused(write, change: dict[str, str], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        read_header(write(save({"a": np.ones(1, np.float16)}, metadata=entries(**change))))


def test_weights_that_are_not_finite_are_refused(write) -> None:
    path = write(save({"a": np.array([np.nan], np.float16)}, metadata=entries()))
    with pytest.raises(InvalidInput, match="a: holds values that are not finite"):
        read_tensors(path)


def test_weights_of_whole_numbers_are_refused(write) -> None:
    path = write(save({"a": np.array([1], np.int64)}, metadata=entries()))
    with pytest.raises(InvalidInput, match="not floating point"):
        read_tensors(path)


def test_a_longest_side_is_kept_outside_the_provenance(write) -> None:
    header = read_header(write(function_file_bytes(TENSORS, **GIVEN, longest_side=960)))
    assert header.longest_side == 960
    assert dict(header.provenance) == GIVEN["provenance"]
    assert read_header(write(function_file_bytes(TENSORS, **GIVEN))).longest_side is None


@pytest.mark.parametrize("value", ["-1", "0", "true", "9.5", '"960"'])
def test_a_longest_side_that_is_not_a_number_of_pixels_is_refused(write, value: str) -> None:
    with pytest.raises(InvalidInput, match="longest-side"):
        read_header(write(save({"a": np.ones(1, np.float16)}, metadata=entries(**{"longest-side": value}))))
