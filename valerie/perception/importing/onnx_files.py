"""Looks at an ONNX file from outside before any library opens it: one file, standard operators, nothing that loops.

An ONNX file is data, but it can name other files, operators of other libraries, endless loops, and tensors far larger than
itself. All of this is refused here, without the onnx package and without building the model in memory, so that the server
that takes uploads needs neither. What remains, work and memory of a network that is merely large, is bounded where it runs.
Field numbers: onnx/onnx.proto of ONNX (IR version 13).
"""

from __future__ import annotations

import math
import mmap
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing.wire import MalformedError, fields, varints

#: Protobuf itself ends at 2 GB, and a network is held more than once while it is compiled.
MAX_BYTES: Final = 1 << 30
MAX_NODES: Final = 20_000
#: Graphs within graphs (the branches of If).
MAX_DEPTH: Final = 4

_STANDARD: Final = ("", "ai.onnx")
_ENDLESS: Final = frozenset({"Loop", "Scan"})
_RANDOM: Final = frozenset(
    {"RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli"}
)
_EXTERNAL: Final = 1


@dataclass(frozen=True, slots=True)
class OnnxSummary:
    """What a file says of itself.

    Attributes:
        opset: version of the standard operators.
        producer: what wrote it, e.g. ``pytorch 2.13.0``.
        nodes: operators, those of inner graphs included.
        inputs, outputs: name and lengths of the axes, None where free; inputs that have a value in the file are left out.
    """

    opset: int
    producer: str
    nodes: int
    inputs: tuple[tuple[str, tuple[int | None, ...]], ...]
    outputs: tuple[tuple[str, tuple[int | None, ...]], ...]


def check_onnx(path: Path, *, max_bytes: int = MAX_BYTES) -> OnnxSummary:
    """Refuse what no function under test needs.

    Raises:
        NotFound: no such file.
        InvalidInput: too large, not ONNX, data in other files, operators that are not standard or not reproducible, loops,
            local functions, tensors whose stated size is not there, too many nodes.
    """
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise InvalidInput(
                "the file is too large", field=path.name, value=f"{size} bytes", limit=f"{max_bytes} bytes"
            )
        if size == 0:
            raise InvalidInput("the file is empty", field=path.name)
        with path.open("rb") as stream:
            # Closed when the last view of it is gone, which an error's traceback may hold.
            mapped = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        return _Check(path.name).model(memoryview(mapped))
    except FileNotFoundError:
        raise NotFound("ONNX file", path.name) from None


class _Check:
    def __init__(self, field: str) -> None:
        self._field = field
        self._nodes = 0

    def model(self, message: memoryview) -> OnnxSummary:
        """ModelProto."""
        try:
            return self._model(message)
        except (MalformedError, UnicodeDecodeError) as error:
            raise InvalidInput(f"not an ONNX file ({error})", field=self._field) from None

    def _model(self, message: memoryview) -> OnnxSummary:
        opset, producer, version = 0, "", ""
        graph: memoryview | None = None
        for number, _, data in fields(message):
            match number:
                case 2:
                    producer = _text(data)
                case 3:
                    version = _text(data)
                case 7:
                    graph = data
                case 8:
                    opset = max(opset, self._opset(data))
                case 20:
                    raise self._refused("holds a graph for training")
                case 25:
                    raise self._refused("holds local functions; inline them first: onnx.inliner.inline_local_functions")
        if graph is None or not opset:
            raise MalformedError("it holds no graph, or no version of operators")
        inputs, outputs = self._graph(graph, 1)
        return OnnxSummary(opset, f"{producer} {version}".strip()[:200], self._nodes, inputs, outputs)

    def _opset(self, message: memoryview) -> int:
        domain, version = "", 0
        for number, value, data in fields(message):
            if number == 1:
                domain = _text(data)
            elif number == 2:
                version = value
        # A foreign domain that no node uses does no harm; nodes are looked at one by one.
        return version if domain in _STANDARD else 0

    def _graph(
        self, message: memoryview, depth: int
    ) -> tuple[tuple[tuple[str, tuple[int | None, ...]], ...], tuple[tuple[str, tuple[int | None, ...]], ...]]:
        """GraphProto."""
        if depth > MAX_DEPTH:
            raise self._refused("graphs within graphs", value=depth, limit=MAX_DEPTH)
        inputs, outputs = [], []
        held: set[str] = set()
        for number, _, data in fields(message):
            match number:
                case 1:
                    self._node(data, depth)
                case 5:
                    held.add(self._tensor(data))
                case 11:
                    inputs.append(_value(data))
                case 12:
                    outputs.append(_value(data))
                case 15:
                    self._sparse(data)
        return tuple(one for one in inputs if one[0] not in held), tuple(outputs)

    def _node(self, message: memoryview, depth: int) -> None:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise self._refused("too many operators", value=f"more than {MAX_NODES}", limit=MAX_NODES)
        kind, domain = "", ""
        for number, _, data in fields(message):
            match number:
                case 4:
                    kind = _text(data)
                case 5:
                    self._attribute(data, depth)
                case 7:
                    domain = _text(data)
        if domain not in _STANDARD:
            raise self._refused("an operator that is not of standard ONNX", value=f"{domain}.{kind}", limit="ai.onnx")
        if kind in _ENDLESS:
            raise self._refused("an operator that may never end", value=kind)
        if kind in _RANDOM:
            raise self._refused("an operator that draws random numbers; results could not be reproduced", value=kind)

    def _attribute(self, message: memoryview, depth: int) -> None:
        for number, _, data in fields(message):
            match number:
                case 5 | 10:
                    self._tensor(data)
                case 6 | 11:
                    self._graph(data, depth + 1)
                case 22 | 23:
                    self._sparse(data)

    def _sparse(self, message: memoryview) -> None:
        for number, _, data in fields(message):
            if number in (1, 2):
                self._tensor(data)

    def _tensor(self, message: memoryview) -> str:
        """TensorProto; returns its name."""
        name = ""
        lengths: list[int] = []
        held = 0
        for number, value, data in fields(message):
            match number:
                case 1:
                    lengths += list(varints(data)) if data else [value]
                case 4 | 5 | 6 | 7 | 9 | 10 | 11:
                    # A number that is not packed has no bytes of its own here.
                    held += len(data) or 1
                case 8:
                    name = _text(data)
                case 13:
                    raise self._refused("data in another file; save the network as one file", value=name)
                case 14 if value == _EXTERNAL:
                    raise self._refused("data in another file; save the network as one file", value=name)
        # The smallest elements are of four bits.
        if math.prod(lengths) > 2 * held:
            shape = " × ".join(map(str, lengths))
            raise self._refused(
                "a tensor that states more than it holds", value=f"{name}: {shape}", limit=f"{held} bytes"
            )
        return name

    def _refused(self, message: str, *, value: object = None, limit: object = None) -> InvalidInput:
        return InvalidInput(message, field=self._field, value=value, limit=limit)


def _value(message: memoryview) -> tuple[str, tuple[int | None, ...]]:
    """ValueInfoProto: name and lengths of the axes."""
    name = ""
    axes: list[int | None] = []
    for number, _, data in fields(message):
        if number == 1:
            name = _text(data)
        elif number == 2:
            axes = [_length(axis) for kind in _inner(data, 1) for shape in _inner(kind, 2) for axis in _inner(shape, 1)]
    return name, tuple(axes)


def _inner(message: memoryview, wanted: int) -> list[memoryview]:
    return [data for number, _, data in fields(message) if number == wanted]


def _length(message: memoryview) -> int | None:
    return next((value for number, value, _ in fields(message) if number == 1), None)


def _text(data: memoryview) -> str:
    return str(data, "utf-8")
