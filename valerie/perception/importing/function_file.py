"""The file of a trained function: fp16 safetensors with its provenance in the header.

The format contains only data (a JSON header and raw tensors), so reading a file never runs code. Nothing here imports torch,
so every process can read names, cards and shapes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from valerie.errors import InvalidInput, NotFound
from valerie.labels import TRAIN_LABELS
from valerie.perception.base import FunctionCard

#: Value of the header's ``format`` entry; raise the number when readers must change.
FORMAT: Final = "valerie-function/1"
#: Class names in the header, in train-id order.
CLASS_NAMES: Final = tuple(label.name for label in TRAIN_LABELS)

_REQUIRED: Final = ("format", "architecture", "classes", "mean", "std")
_LONGEST_SIDE: Final = "longest-side"
_OWN: Final = frozenset((*_REQUIRED, _LONGEST_SIDE))


@dataclass(frozen=True, slots=True)
class FunctionHeader:
    """The header of a function file.

    Attributes:
        architecture: a name in `valerie.perception.networks.architectures`.
        mean, std: per channel (red, green, blue) of sRGB values in [0, 1]; the network sees ``(x − mean) / std``.
        longest_side: pixels; longer frames are resampled to it (`InputDocument`); None: frames keep their size.
        provenance: all other entries: seeds, steps, data set, figures, licence …
        shapes: tensor name to shape.
        digest: SHA-256 of the whole file, hex.
    """

    architecture: str
    mean: tuple[float, float, float]
    std: tuple[float, float, float]
    longest_side: int | None
    provenance: Mapping[str, str]
    shapes: Mapping[str, tuple[int, ...]]
    digest: str

    def card(self, name: str, *, precision: str, engine: str) -> FunctionCard:
        """Return the card of this file under a name."""
        return FunctionCard(name, self.digest, self.architecture, precision, engine, dict(self.provenance))


def read_header(path: Path) -> FunctionHeader:
    """Read and check the header of a function file.

    Raises:
        NotFound: no such file.
        InvalidInput: not safetensors, the header does not fit the data, or entries are missing or wrong.
    """
    field = path.name
    digest = _digest(path)
    try:
        with safe_open(path, framework="numpy") as tensors:
            entries: dict[str, str] = tensors.metadata() or {}
            shapes = {name: tuple(tensors.get_slice(name).get_shape()) for name in tensors.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InvalidInput(f"not a readable safetensors file ({error})", field=field) from error
    missing = [name for name in _REQUIRED if name not in entries]
    if missing:
        raise InvalidInput(
            "entries of the header are missing", field=field, value=", ".join(missing), limit=", ".join(_REQUIRED)
        )
    if entries["format"] != FORMAT:
        raise InvalidInput(
            "not the file format of this program", field=f"{field}: format", value=entries["format"], limit=FORMAT
        )
    classes = _json_entry(entries, "classes", field)
    if classes != list(CLASS_NAMES):
        raise InvalidInput(
            "not the classes of this program", field=f"{field}: classes", value=classes, limit=list(CLASS_NAMES)
        )
    provenance = {name: text for name, text in sorted(entries.items()) if name not in _OWN}
    return FunctionHeader(
        architecture=entries["architecture"],
        mean=_triple(entries, "mean", field),
        std=_triple(entries, "std", field, positive=True),
        longest_side=_side(entries, field),
        provenance=MappingProxyType(provenance),
        shapes=MappingProxyType(shapes),
        digest=digest,
    )


def read_tensors(path: Path) -> dict[str, NDArray[np.floating]]:
    """Return all tensors of a file that `read_header` accepted, as stored.

    Raises:
        InvalidInput: a tensor is not floating point or contains values that are not finite.
    """
    tensors: dict[str, NDArray[np.floating]] = {}
    try:
        with safe_open(path, framework="numpy") as file:
            for name in sorted(file.keys()):
                tensor = file.get_tensor(name)
                if not np.issubdtype(tensor.dtype, np.floating):
                    raise InvalidInput("not floating point", field=f"{path.name}: {name}", value=str(tensor.dtype))
                if not np.isfinite(tensor).all():
                    raise InvalidInput("holds values that are not finite", field=f"{path.name}: {name}")
                tensors[name] = tensor
    except (SafetensorError, OSError) as error:
        raise InvalidInput(f"not a readable safetensors file ({error})", field=path.name) from error
    return tensors


def function_file_bytes(
    tensors: Mapping[str, NDArray[np.floating]],
    *,
    architecture: str,
    mean: tuple[float, float, float],
    std: tuple[float, float, float],
    provenance: Mapping[str, str],
    longest_side: int | None = None,
) -> bytes:
    """Return the bytes of a function file; equal inputs give equal bytes.

    Args:
        tensors: parameters and buffers by name; stored by `compact`.
        architecture: name of their architecture.
        mean: per channel, of sRGB values in [0, 1].
        std: per channel, likewise.
        provenance: further header entries.
        longest_side: pixels; longer frames are resampled to it.

    Raises:
        InvalidInput: a value is not finite, or a provenance entry has a name that the format reserves.
    """
    reserved = sorted(set(provenance) & _OWN)
    if reserved:
        raise InvalidInput("names that the format reserves", field="provenance", value=", ".join(reserved))
    for name in sorted(tensors):
        if not np.isfinite(tensors[name]).all():
            raise InvalidInput("holds values that are not finite", field=name)
    entries = {
        "format": FORMAT,
        "architecture": architecture,
        "classes": json.dumps(CLASS_NAMES),
        "mean": json.dumps(mean),
        "std": json.dumps(std),
        **({} if longest_side is None else {_LONGEST_SIDE: json.dumps(longest_side)}),
        **provenance,
    }
    return safetensors_bytes({name: compact(tensor) for name, tensor in tensors.items()}, entries)


def compact(tensor: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return a tensor as stored in function files: float16, or float32 if values exceed ±65504, as running variances may."""
    with np.errstate(over="ignore"):
        half = np.ascontiguousarray(tensor, np.float16)
    return half if np.isfinite(half).all() else np.ascontiguousarray(tensor, np.float32)


def safetensors_bytes(tensors: Mapping[str, NDArray[np.floating]], entries: Mapping[str, str]) -> bytes:
    """Return the bytes of a safetensors file; equal inputs in any order give equal bytes."""
    data: bytes = save({name: tensors[name] for name in sorted(tensors)}, metadata=dict(entries))
    # The library writes metadata in random order: write the header again with sorted keys.
    size = int.from_bytes(data[:8], "little")
    header = json.dumps(
        json.loads(data[8 : 8 + size]), sort_keys=True, separators=(",", ":"), ensure_ascii=False
    ).encode()
    header += b" " * (-len(header) % 8)  # the format requires that tensors start at a multiple of 8 bytes
    return len(header).to_bytes(8, "little") + header + data[8 + size :]


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except FileNotFoundError:
        raise NotFound("function file", path.name) from None


def _json_entry(entries: Mapping[str, str], name: str, field: str) -> object:
    try:
        value: object = json.loads(entries[name])
    except ValueError:
        raise InvalidInput("not JSON", field=f"{field}: {name}", value=entries[name]) from None
    return value


def _side(entries: Mapping[str, str], field: str) -> int | None:
    if _LONGEST_SIDE not in entries:
        return None
    value = _json_entry(entries, _LONGEST_SIDE, field)
    if isinstance(value, int) and not isinstance(value, bool) and value > 0:
        return value
    raise InvalidInput("not a number of pixels", field=f"{field}: {_LONGEST_SIDE}", value=value)


def _triple(entries: Mapping[str, str], name: str, field: str, *, positive: bool = False) -> tuple[float, float, float]:
    value = _json_entry(entries, name, field)
    if isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value):
        red, green, blue = (float(x) for x in value)
        if np.isfinite([red, green, blue]).all() and (not positive or min(red, green, blue) > 0.0):
            return red, green, blue
    kind = "three positive numbers" if positive else "three numbers"
    raise InvalidInput(f"not {kind}", field=f"{field}: {name}", value=value)
