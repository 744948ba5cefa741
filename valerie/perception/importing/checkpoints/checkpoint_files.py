"""Read checkpoint files of any accepted format: tensors as numpy arrays, and the entries beside them.

Accepted formats are torch.save (the zip archive and the older stream of pickles), bare pickles of numpy arrays as detectron2
publishes them, and safetensors. The first bytes of a file decide its format; its name does not.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing.checkpoints.unpickling import PickledArray, Storage, Tensor, load_plain, storage_of
from valerie.plain import JsonObject

#: Largest file that is read. A ResNet-101 with its optimiser's state is about half a gigabyte.
MAX_BYTES: Final = 4 * 2**30
#: Largest pickle inside an archive: it contains names and shapes, no numbers.
_MAX_INNER_PICKLE: Final = 64 * 2**20
_MAX_ENTRIES: Final = 100_000
_MAX_SAFETENSORS_HEADER: Final = 100_000_000

_ZIP: Final = b"PK\x03\x04"
#: First object of torch.save's older format, and the version after it.
_STREAM_MAGIC: Final = 0x1950A86A20F9469CFC6C
_STREAM_VERSION: Final = 1001

#: Entries in which programs keep the weights, in order of preference.
_CONTAINERS: Final = ("state_dict", "model_state", "model_state_dict", "model")


@dataclass(frozen=True, slots=True)
class StoredCheckpoint:
    """The contents of a checkpoint file.

    Attributes:
        tensors: by the file's own names, without the prefix of data-parallel training.
        entries: text, numbers and lists beside the weights, by dotted name, e.g. ``meta.CLASSES``.
        format: ``safetensors``, ``torch`` or ``pickle``.
    """

    tensors: Mapping[str, NDArray[Any]]
    entries: JsonObject
    format: str


def read_stored_checkpoint(path: Path, *, max_bytes: int = MAX_BYTES) -> StoredCheckpoint:
    """Read a checkpoint without running anything in it.

    Weights need no more memory than the size of the file (bfloat16: twice that). A hostile pickle may need more memory and
    time: call this in a bounded process such as `valerie.pipeline.functions.import_child`.

    Raises:
        NotFound: no such file.
        InvalidInput: the file is too large, damaged, of a format that can run code, or without weights.
    """
    field = path.name
    try:
        size = path.stat().st_size
        stream = path.open("rb")
    except (FileNotFoundError, IsADirectoryError):
        raise NotFound("checkpoint file", path.name) from None
    if size > max_bytes:
        stream.close()
        raise InvalidInput("the file is too large", field=field, value=f"{size} bytes", limit=f"{max_bytes} bytes")
    with stream:
        start = stream.read(16)
        stream.seek(0)
        if start.startswith(_ZIP):
            return _weights(_read_archive(stream, size, field), "torch", field)
        # A header of 128 bytes begins like a pickle, but its length has zeros where a pickle has none.
        if start[8:9] == b"{" and (start[4:8] == bytes(4) or start[:1] != b"\x80"):
            return _read_safetensors(path, int.from_bytes(start[:8], "little"), size)
        if start.startswith(b"\x80"):
            first = load_plain(stream, field=field)
            if first == _STREAM_MAGIC:
                return _weights(_read_torch_stream(stream, field), "torch", field)
            return _weights(first, "pickle", field)
    raise InvalidInput(
        "not a checkpoint", field=field, limit="safetensors, a file of torch.save, or a pickle of numpy arrays"
    )


def _read_archive(stream: IO[bytes], size: int, field: str) -> Any:
    """Return the objects of a zip archive that torch.save wrote."""
    try:
        with zipfile.ZipFile(stream) as archive:
            entries = archive.infolist()
            names = {entry.filename: entry for entry in entries}
            _refuse_programs(names, field)
            _require_plain_archive(entries, size, field)
            roots = [
                name.removesuffix("/data.pkl") for name in names if name.count("/") == 1 and name.endswith("/data.pkl")
            ]
            if len(roots) != 1:
                raise InvalidInput(
                    "this zip archive was not written by torch.save", field=field, limit="one */data.pkl"
                )
            root = roots[0]
            order = names.get(f"{root}/byteorder")
            if order is not None and archive.read(order) != b"little":
                raise InvalidInput("the numbers are not little-endian", field=field, limit="little-endian")
            pickled = names[f"{root}/data.pkl"]
            if pickled.file_size > _MAX_INNER_PICKLE:
                limit = f"{_MAX_INNER_PICKLE} bytes"
                raise InvalidInput("the inner pickle is too large", field=field, value=pickled.file_size, limit=limit)
            storages: dict[str, Storage] = {}

            def storage(pid: Any) -> Storage:
                _, kind, key, _, count = pid
                if key not in storages:
                    storages[key] = storage_of(kind, count)
                elif (storages[key].kind, storages[key].count) != (kind.name, count):
                    raise ValueError(f"storage {key!r} is described in two ways")
                return storages[key]

            with archive.open(pickled) as inner:
                objects = load_plain(inner, field=field, storage=storage)
            for key, filled in storages.items():
                filled.fill(archive.read(f"{root}/data/{key}"), field=f"{field}: storage {key}")
            return objects
    except (zipfile.BadZipFile, KeyError, NotImplementedError, EOFError) as error:
        raise InvalidInput(f"not a readable zip archive ({error})", field=field) from None


def _require_plain_archive(entries: list[zipfile.ZipInfo], size: int, field: str) -> None:
    """Refuse archives that torch.save never writes, and those that could expand when they are read."""
    if len(entries) > _MAX_ENTRIES:
        raise InvalidInput("too many entries", field=field, value=len(entries), limit=_MAX_ENTRIES)
    for entry in entries:
        if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 0x1:
            raise InvalidInput(
                "compressed or encrypted entries; torch.save writes neither", field=f"{field}: {entry.filename}"
            )
    total = sum(entry.file_size for entry in entries)
    if total > size:
        raise InvalidInput(
            "the entries are larger than the file", field=field, value=f"{total} bytes", limit=f"{size} bytes"
        )


def _refuse_programs(names: Iterable[str], field: str) -> None:
    tails = {name.partition("/")[2] for name in names}
    if "constants.pkl" in tails or any(tail.startswith("code/") for tail in tails):
        raise InvalidInput(
            "a TorchScript archive holds a program and is not accepted; export the network as ONNX", field=field
        )
    if tails & {"archive_format", "serialized_exported_program.json"} or any(t.startswith("models/") for t in tails):
        raise InvalidInput(
            "an exported program (.pt2) holds a program and is not accepted; export the network as ONNX", field=field
        )


def _read_torch_stream(stream: IO[bytes], field: str) -> Any:
    """Return the objects of torch.save's older format: pickles one after another, then the numbers of each storage."""
    version = load_plain(stream, field=field)
    if version != _STREAM_VERSION:
        raise InvalidInput("another version of torch's format", field=field, limit=_STREAM_VERSION)
    system = load_plain(stream, field=field)
    if not isinstance(system, dict) or system.get("little_endian") is not True:
        raise InvalidInput("the numbers are not little-endian", field=field, limit="little-endian")
    storages: dict[str, Storage] = {}

    def storage(pid: Any) -> Storage:
        _, kind, key, _, count, view = pid
        if view is not None:
            raise ValueError("a view of a storage, which only very old versions of torch wrote")
        return storages.setdefault(key, storage_of(kind, count))

    objects = load_plain(stream, field=field, storage=storage)
    keys = load_plain(stream, field=field)
    if not isinstance(keys, list) or sorted(map(str, keys)) != sorted(map(str, storages)):
        raise InvalidInput("the file does not hold the data of its tensors", field=field)
    for key in keys:
        filled = storages[key]
        stated = int.from_bytes(stream.read(8), "little")
        if stated != filled.count:
            raise InvalidInput(
                "two lengths of one storage", field=f"{field}: storage {key}", value=stated, limit=filled.count
            )
        filled.fill(stream.read(filled.count * filled.dtype.itemsize), field=f"{field}: storage {key}")
    return objects


def _read_safetensors(path: Path, header: int, size: int) -> StoredCheckpoint:
    field = path.name
    if header > min(size - 8, _MAX_SAFETENSORS_HEADER):
        limit = f"{min(size - 8, _MAX_SAFETENSORS_HEADER)} bytes"
        raise InvalidInput("the header is longer than it can be", field=field, value=f"{header} bytes", limit=limit)
    try:
        with safe_open(path, framework="numpy") as opened:
            entries: JsonObject = dict(opened.metadata() or {})
            tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, TypeError) as error:
        raise InvalidInput(f"not a readable safetensors file ({error})", field=field) from error
    return StoredCheckpoint(tensors, entries, "safetensors")


def _weights(objects: Any, kind: str, field: str) -> StoredCheckpoint:
    """Find the mapping of names to tensors, and flatten the entries beside it."""
    container, weights = "", objects
    if isinstance(objects, dict):
        for name in _CONTAINERS:
            if isinstance(objects.get(name), dict):
                container, weights = name, objects[name]
                break
    tensors: dict[str, NDArray[Any]] = {}
    if isinstance(weights, dict):
        for name, value in weights.items():
            if isinstance(value, Tensor | PickledArray) and isinstance(name, str):
                tensors[name.removeprefix("module.")] = value.array()
    if not tensors:
        raise InvalidInput(
            "the file holds no weights", field=field, limit=f"tensors by name, alone or in {_CONTAINERS}"
        )
    beside = {name: value for name, value in objects.items() if name != container} if container else {}
    return StoredCheckpoint(tensors, _flattened(beside), kind)


def _flattened(values: Mapping[Any, Any]) -> JsonObject:
    """Return text, numbers and lists of nested dictionaries by dotted name.

    Each dictionary is entered once: a pickle may refer to one in many places, which would make exponentially many names.
    """
    flat: JsonObject = {}
    visits = {id(values)}
    waiting: list[tuple[str, Mapping[Any, Any]]] = [("", values)]
    while waiting:
        before, mapping = waiting.pop()
        for name, value in mapping.items():
            if isinstance(value, dict) and id(value) not in visits:
                visits.add(id(value))
                waiting.append((f"{before}{name}.", value))
            elif isinstance(value, str | int | float | list | tuple):
                flat[f"{before}{name}"] = value
    return flat
