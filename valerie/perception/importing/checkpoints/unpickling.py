"""Read the pickles of checkpoints without running anything that they name.

A pickle is a program: it names functions and the arguments to call them with. This module replaces every function that a
checkpoint of numbers needs with a stand-in that only keeps its arguments, and refuses a file that names any other. numpy's
and torch's own unpickling never runs, since its C code trusts the sizes that a file states.

Nothing here bounds memory or time; `valerie.pipeline.functions.import_child` does.
"""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import InvalidInput

_MAX_DIMENSIONS: Final = 8
_DTYPE: Final = re.compile(r"[fiub][1248]|\?")

#: torch's storage classes to numpy's dtypes; bfloat16, which numpy lacks, is kept as its 16 bits.
STORAGE_DTYPES: Final[Mapping[str, np.dtype[Any]]] = MappingProxyType(
    {
        "FloatStorage": np.dtype("<f4"),
        "DoubleStorage": np.dtype("<f8"),
        "HalfStorage": np.dtype("<f2"),
        "BFloat16Storage": np.dtype("<u2"),
        "LongStorage": np.dtype("<i8"),
        "IntStorage": np.dtype("<i4"),
        "ShortStorage": np.dtype("<i2"),
        "CharStorage": np.dtype("<i1"),
        "ByteStorage": np.dtype("<u1"),
        "BoolStorage": np.dtype("?"),
    }
)


class _Refused(Exception):
    """Raised for content that checkpoints of numbers do not have."""


class _Fixed:
    """An object that a pickle cannot change after it was checked."""

    def __setstate__(self, state: object) -> None:
        raise _Refused(f"a change of {type(self).__name__.strip('_')}")


class Inert:
    """Stand-in for an irrelevant object, such as a training log. It accepts every call and keeps nothing."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def __setstate__(self, state: object) -> None: ...

    def __setitem__(self, key: object, value: object) -> None: ...

    def append(self, item: object) -> None: ...

    def extend(self, items: object) -> None: ...


class _Mapping(dict[Any, Any]):
    """An ordered dictionary; attributes, which torch gives to those of its modules, are ignored."""

    def __setstate__(self, state: object) -> None: ...


class Storage(_Fixed):
    """The numbers behind one or more tensors, which are stored elsewhere in the file.

    Attributes:
        kind: torch's name, e.g. ``FloatStorage``.
        count: number of numbers, by the pickle.
        numbers: (count,) after `fill`, None before; bfloat16 as float32.
    """

    def __init__(self, kind: str, count: int) -> None:
        self.kind, self.count = kind, count
        self.numbers: NDArray[Any] | None = None

    @property
    def dtype(self) -> np.dtype[Any]:
        """Dtype of the numbers in the file."""
        return STORAGE_DTYPES[self.kind]

    def fill(self, data: bytes, *, field: str) -> None:
        """Take the numbers from the file's bytes.

        Raises:
            InvalidInput: the length differs from that in the pickle.
        """
        if len(data) != self.count * self.dtype.itemsize:
            limit = f"{self.count} numbers of {self.dtype.itemsize} bytes"
            raise InvalidInput("the data of a storage have another length", field=field, value=len(data), limit=limit)
        numbers = np.frombuffer(data, self.dtype)
        if self.kind == "BFloat16Storage":  # the upper half of a float32
            numbers = (numbers.astype(np.uint32) << 16).view(np.float32)
        self.numbers = numbers


class Tensor(_Fixed):
    """A tensor of torch: a strided view of a storage."""

    def __init__(self, storage: object, offset: object, size: object, stride: object, *_: object) -> None:
        if not isinstance(storage, Storage):
            raise _Refused("a tensor without a storage")
        self.storage = storage
        self.offset = _count(offset, "a tensor's offset")
        self.shape, self.stride = _counts(size, "a tensor's size"), _counts(stride, "a tensor's stride")
        if len(self.shape) != len(self.stride):
            raise _Refused("a tensor with more sizes than strides")
        elements = math.prod(self.shape)
        last = self.offset + sum((n - 1) * step for n, step in zip(self.shape, self.stride, strict=True))
        # A tensor with more elements than its storage repeats them: a small file would become a vast array.
        if elements and (last >= storage.count or elements > storage.count):
            raise _Refused(f"a tensor of {list(self.shape)} in a storage of {storage.count} numbers")

    def array(self) -> NDArray[Any]:
        """Return a read-only view of the numbers."""
        if self.storage.numbers is None:
            raise _Refused("the data of a tensor are missing")
        if 0 in self.shape:
            return np.zeros(self.shape, self.storage.numbers.dtype)
        numbers = self.storage.numbers[self.offset :]
        strides = [step * numbers.itemsize for step in self.stride]
        return np.lib.stride_tricks.as_strided(numbers, self.shape, strides, writeable=False)


class PickledArray:
    """An array of numpy."""

    def __init__(self, values: NDArray[Any] | None = None) -> None:
        self._values = values

    def __setstate__(self, state: Any) -> None:
        shape, dtype, fortran, data = state[-4:]
        self._values = _array(data, dtype, _counts(shape, "an array's shape"), "F" if fortran else "C")

    def array(self) -> NDArray[Any]:
        """Return the numbers."""
        if self._values is None:
            raise _Refused("an array without data")
        return self._values


class _Dtype:
    """A dtype of numpy; only plain numbers."""

    def __init__(self, code: object, *_: object) -> None:
        if not isinstance(code, str) or not _DTYPE.fullmatch(code):
            raise _Refused(f"an array of kind {_shown(code)}")
        self.value: np.dtype[Any] = np.dtype(code)

    def __setstate__(self, state: Any) -> None:
        order, subtype, names, fields = state[1:5]
        if order not in ("<", ">", "|", "=") or not (subtype is None and names is None and fields is None):
            raise _Refused("an array of records")
        self.value = self.value.newbyteorder(order)


class _StorageKind(_Fixed):
    """A storage class of torch, by name."""

    def __init__(self, name: str) -> None:
        self.name = name


def load_plain(stream: IO[bytes], *, field: str, storage: Callable[[Any], Storage] | None = None) -> Any:
    """Return the objects of one pickle, with stand-ins for tensors (`Tensor`) and arrays (`PickledArray`).

    Args:
        stream: positioned at the pickle's first byte; after the call, just after its last.
        field: the file's name, for messages.
        storage: returns the storage of a persistent id; None if the file has no such ids.

    Raises:
        InvalidInput: not a pickle, a damaged one, or one with names or actions that checkpoints of numbers do not have.
    """
    try:
        return _Unpickler(stream, storage).load()
    except _Refused as refused:
        raise InvalidInput(f"not a checkpoint of numbers only: it contains {refused}", field=field) from None
    except Exception as error:  # a damaged or hostile pickle may fail in any way; to a user all mean the same
        raise InvalidInput(f"not a readable pickle ({type(error).__name__}: {error})", field=field) from None


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: IO[bytes], storage: Callable[[Any], Storage] | None) -> None:
        super().__init__(stream, encoding="latin1")  # as files from Python 2 need it
        self._storage = storage

    def find_class(self, module: str, name: str) -> Any:
        """Return the stand-in of a name."""
        module = module.replace("numpy._core.", "numpy.core.")
        if module == "torch" and name in STORAGE_DTYPES:
            return _StorageKind(name)
        try:
            return _STAND_INS[module, name]
        except KeyError:
            raise _Refused(f"{module}.{name}") from None

    def persistent_load(self, pid: Any) -> Storage:
        if self._storage is None:
            raise _Refused("a reference to something outside the file")
        return self._storage(pid)


def storage_of(kind: object, count: object) -> Storage:
    """Return the storage that a persistent id describes.

    Raises:
        _Refused: not a storage class of torch, or not a count.
    """
    if not isinstance(kind, _StorageKind):
        raise _Refused("a storage of unknown kind")
    return Storage(kind.name, _count(count, "a storage's size"))


def _shown(value: object) -> str:
    """Return the text of a value for a message; for nested values only the type, since writing them out may never end."""
    return repr(value) if isinstance(value, int | str | None) else type(value).__name__


def _reconstruct(*_: object) -> PickledArray:
    return PickledArray()


def _from_buffer(data: object, dtype: object, shape: object, order: object) -> PickledArray:
    return PickledArray(_array(data, dtype, _counts(shape, "an array's shape"), "F" if order == "F" else "C"))


def _scalar(dtype: object, data: object = b"") -> object:
    return _array(data, dtype, (1,), "C")[0].item()


def _encode(text: object, encoding: object = "latin1") -> bytes:
    # Protocol 2 writes bytes as text that has to be encoded; nothing else uses this.
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise _Refused(f"text in {_shown(encoding)}")
    return text.encode("latin1")


def _parameter(tensor: object, *_: object) -> object:
    return tensor


def _array(data: object, dtype: object, shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    if isinstance(data, str):  # Python 2 knew no bytes
        data = data.encode("latin1")
    if not isinstance(dtype, _Dtype) or not isinstance(data, bytes | bytearray):
        raise _Refused("an array of objects")
    if math.prod(shape) * dtype.value.itemsize != len(data):
        raise _Refused(f"an array of {list(shape)} {dtype.value} in {len(data)} bytes")
    values = np.frombuffer(data, dtype.value).reshape(shape, order=order)
    return values if values.dtype.isnative else values.astype(values.dtype.newbyteorder("="))


def _count(value: object, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**48:
        raise _Refused(f"{what} of {_shown(value)}")
    return value


def _counts(value: object, what: str) -> tuple[int, ...]:
    if not isinstance(value, tuple | list) or len(value) > _MAX_DIMENSIONS:
        raise _Refused(f"{what} of {_shown(value)}")
    return tuple(_count(each, what) for each in value)


class _Call(_Fixed):
    """A callable that a pickle can call and cannot change."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)


_STAND_INS: Final[Mapping[tuple[str, str], Any]] = MappingProxyType(
    {
        ("collections", "OrderedDict"): _Mapping,
        ("_codecs", "encode"): _Call(_encode),
        ("numpy", "ndarray"): Inert,
        ("numpy", "dtype"): _Call(_Dtype),
        ("numpy.core.multiarray", "_reconstruct"): _Call(_reconstruct),
        ("numpy.core.multiarray", "scalar"): _Call(_scalar),
        ("numpy.core.numeric", "_frombuffer"): _Call(_from_buffer),
        ("torch", "Size"): _Call(tuple),
        ("torch", "device"): Inert,
        ("torch._utils", "_rebuild_tensor"): _Call(Tensor),
        ("torch._utils", "_rebuild_tensor_v2"): _Call(Tensor),
        ("torch._utils", "_rebuild_parameter"): _Call(_parameter),
        # mmengine's training log, which is stored beside the weights and refers to its methods by getattr
        ("mmengine.logging.history_buffer", "HistoryBuffer"): Inert,
        ("builtins", "getattr"): Inert,
        ("__builtin__", "getattr"): Inert,
    }
)
