import copyreg
import io
import os
import pickle
import struct
import sys
from collections import OrderedDict
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from valerie.errors import InvalidInput
from valerie.perception.importing.checkpoints.unpickling import Inert, PickledArray, load_plain


def load(data: bytes) -> object:
    return load_plain(io.BytesIO(data), field="f.pkl")


class Calls:
    """Pickles into a call of ``function``, and then into a change of the result's state."""

    def __init__(self, function, *arguments, state=None) -> None:
        self.reduced = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self):
        return self.reduced


@pytest.mark.parametrize("protocol", range(2, 6))
def test_objects_of_checkpoints_come_back_equal(protocol: int) -> None:
    state = {
        "a": [1, 2.5, "text", None, True],
        "b": OrderedDict(x=(1, 2), y=b"bytes"),
        "c": np.float64(0.75),
        "d": {1, 2},
    }
    if protocol < 4:
        del state["d"]  # a set is a call of a built-in function there
    assert load(pickle.dumps(state, protocol)) == state


@pytest.mark.parametrize("protocol", range(2, 6))
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", "<f2", "<i8", "|u1", "|b1"])
def test_an_array_comes_back_with_its_numbers(protocol: int, dtype: str) -> None:
    values = np.arange(12).reshape(3, 4).astype(dtype)
    array = load(pickle.dumps(values, protocol))
    assert isinstance(array, PickledArray)
    np.testing.assert_array_equal(array.array(), values)
    assert array.array().dtype.isnative
    turned = load(pickle.dumps(np.asfortranarray(values), protocol))
    assert isinstance(turned, PickledArray)
    np.testing.assert_array_equal(turned.array(), values)


def test_an_array_that_python_2_wrote_comes_back() -> None:
    opcodes = b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R"
    dtype = b"cnumpy\ndtype\nU\x02f4K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    data = b"\x00\x00\x80?\x00\x00\x00\xc0"  # text there, where Python 3 has bytes
    array = load(b"\x80\x02" + opcodes + b"(K\x01K\x02\x85" + dtype + b"\x89U\x08" + data + b"tb.")
    assert isinstance(array, PickledArray)
    assert array.array().tolist() == [1.0, -2.0]


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("function", [os.system, Path.touch, exec, __import__], ids=lambda f: f.__name__)
def test_a_call_in_a_pickle_is_named_and_not_made(tmp_path: Path, protocol: int, function) -> None:
    mark = tmp_path / "mark"
    argument = {"system": f"touch {mark}", "touch": mark, "exec": f"open({str(mark)!r}, 'w')", "__import__": "this"}
    data = pickle.dumps({"model": Calls(function, argument[function.__name__])}, protocol)
    with pytest.raises(InvalidInput, match=r"contains (posix|pathlib|builtins|__builtin__|copy_reg|nt)"):
        load(data)
    assert not mark.exists()
    assert "this" not in sys.modules


def test_pickle_itself_would_make_that_call(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    pickle.loads(pickle.dumps({"model": Calls(os.system, f"touch {mark}")}))
    assert mark.exists()


@pytest.mark.parametrize("opcodes", [b"(S'touch x'\nios\nsystem\n.", b"(cos\nsystem\nS'touch x'\no."])
def test_older_opcodes_for_calls_are_refused(opcodes: bytes) -> None:
    with pytest.raises(InvalidInput, match=r"contains os\.system"):
        load(opcodes)


def test_a_name_from_the_registry_of_extensions_is_refused() -> None:
    copyreg.add_extension("os", "system", 1)
    try:
        with pytest.raises(InvalidInput, match=r"contains os\.system"):
            load(b"\x82\x01.")
    finally:
        copyreg.remove_extension("os", "system", 1)


@pytest.mark.parametrize("flags", [0, 1, 63])
def test_a_dtype_that_takes_bytes_for_addresses_is_refused(flags: int) -> None:
    """numpy's own dtype accepts this state, and frees the array's bytes as if they were addresses of objects."""
    state = (3, "|", None, ("a",), {"a": (np.dtype("f8"), 0)}, 8, 1, flags)
    dtype = Calls(np.dtype, "V8", False, True, state=state)
    state = (1, (4,), dtype, False, b"\x41" * 32)
    with pytest.raises(InvalidInput, match="an array of kind 'V8'"):
        load(pickle.dumps(Calls(np.zeros(0).__reduce__()[0], np.ndarray, (0,), b"b", state=state), 2))


def test_an_array_of_objects_is_refused() -> None:
    with pytest.raises(InvalidInput, match="an array of kind 'O8'"):
        load(pickle.dumps(np.array([{}], object)))


def test_an_array_of_records_is_refused() -> None:
    with pytest.raises(InvalidInput, match="an array of"):
        load(pickle.dumps(np.zeros(1, [("a", "f4")])))


def test_an_array_larger_than_its_bytes_is_refused() -> None:
    state = (1, (1 << 40,), np.dtype("<f4"), False, b"\x00" * 16)
    with pytest.raises(InvalidInput, match=r"an array of \[1099511627776\] float32 in 16 bytes"):
        load(pickle.dumps(Calls(np.zeros(0).__reduce__()[0], np.ndarray, (0,), b"b", state=state)))


def test_the_stand_in_of_a_function_cannot_be_changed() -> None:
    with pytest.raises(InvalidInput, match="a change of Call"):
        load(b"\x80\x02c_codecs\nencode\n}b.")


def test_a_reference_to_something_outside_the_file_is_refused() -> None:
    class Outside(pickle.Pickler):
        def persistent_id(self, obj: object) -> object:
            return "elsewhere" if obj == 7 else None

    stream = io.BytesIO()
    Outside(stream).dump([7])
    with pytest.raises(InvalidInput, match="outside the file"):
        load(stream.getvalue())


@pytest.mark.parametrize(
    "data",
    [
        b"\x80\x04\x8e" + struct.pack("<Q", 1 << 50) + b"x.",  # a terabyte of bytes, so it says
        b"\x80\x05\x96" + struct.pack("<Q", 1 << 40) + b"x.",
        b"\x80\x02X" + struct.pack("<I", 1 << 31) + b"x.",
        b"\x80\x04\x95" + struct.pack("<Q", 1 << 50) + b"N.",  # a frame
    ],
)
def test_a_length_beyond_the_file_is_refused(data: bytes) -> None:
    with pytest.raises(InvalidInput, match="not a readable pickle"):
        load(data)


@pytest.mark.parametrize(
    "data", [b"", b"\x80", b"\x80\x02", b"\x80\x02}q", b"not a pickle", b"\x80\x02a.", b"\x80\x02h\x05."]
)
def test_a_damaged_pickle_is_refused(data: bytes) -> None:
    with pytest.raises(InvalidInput, match=r"f\.pkl: not a readable pickle"):
        load(data)


def test_a_training_log_is_skipped_without_its_code(monkeypatch: pytest.MonkeyPatch) -> None:
    package, module = ModuleType("mmengine.logging"), ModuleType("mmengine.logging.history_buffer")

    class HistoryBuffer:
        def least(self) -> float:
            return min(self.values)

        def __init__(self) -> None:
            self.values = np.ones(2)
            self.method = HistoryBuffer.least

    HistoryBuffer.__module__, HistoryBuffer.__qualname__ = module.__name__, "HistoryBuffer"
    HistoryBuffer.least.__module__, HistoryBuffer.least.__qualname__ = module.__name__, "HistoryBuffer.least"
    module.HistoryBuffer = HistoryBuffer
    for each in (ModuleType("mmengine"), package, module):
        monkeypatch.setitem(sys.modules, each.__name__, each)
    data = pickle.dumps({"message_hub": HistoryBuffer(), "epoch": 3}, 2)
    monkeypatch.undo()
    loaded = load(data)
    assert isinstance(loaded, dict)
    assert isinstance(loaded["message_hub"], Inert)
    assert loaded["epoch"] == 3
