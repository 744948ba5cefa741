"""Checks of untrusted ONNX files: one file, standard operators, no loops, no tensor larger than its data.

An ONNX file is data, but it can name other files, operators of other libraries and endless loops. An inference engine would
follow all of these. `valerie.pipeline.functions.import_child` bounds memory and time while a file is parsed,
`valerie.pipeline.functions.bounded` while the network runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import onnx
from google.protobuf.message import DecodeError, Message

from valerie.errors import InvalidInput, NotFound

#: Protobuf's own limit is 2 GB, and compiling a network takes several copies of it.
MAX_BYTES: Final = 1 << 30
MAX_NODES: Final = 20_000
#: Depth of graphs within graphs (the branches of If).
MAX_DEPTH: Final = 4

_STANDARD: Final = ("", "ai.onnx")
_ENDLESS: Final = frozenset({"Loop", "Scan"})
_RANDOM: Final = frozenset(
    {"RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Multinomial", "Bernoulli"}
)
#: Operators between float and 8-bit values, and those that compute with 8-bit values.
_QUANTIZED: Final = frozenset(
    {"QuantizeLinear", "DequantizeLinear", "QLinearConv", "QLinearMatMul", "ConvInteger", "MatMulInteger"}
)
#: The smallest elements have two bits: four of them share a byte.
_ELEMENTS_PER_BYTE: Final = 4


def read_onnx(path: Path, *, max_bytes: int = MAX_BYTES) -> onnx.ModelProto:
    """Read an ONNX file and refuse features that no function under test needs.

    Args:
        path: the file.
        max_bytes: larger files are refused unread.

    Raises:
        NotFound: there is no such file.
        InvalidInput: the file is too large or not ONNX, or it contains external data, local functions, a graph for
            training, operators that are not standard, not reproducible or may never end, too many operators, or a tensor
            whose stated size exceeds its data.
    """
    field = path.name
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise InvalidInput("the file is too large", field=field, value=f"{size} bytes", limit=f"{max_bytes} bytes")
        if size == 0:
            raise InvalidInput("the file is empty", field=field)
        model = onnx.load_model_from_string(path.read_bytes(), format="protobuf")
    except FileNotFoundError:
        raise NotFound("ONNX file", field) from None
    except DecodeError as error:
        raise InvalidInput(f"not an ONNX file ({error})", field=field) from None
    if not model.HasField("graph") or operator_set(model) == 0:
        raise InvalidInput("not an ONNX file (it has no graph, or no version of operators)", field=field)
    if model.training_info:
        raise InvalidInput("the file holds a graph for training", field=field)
    if model.functions:
        hint = "inline them first: onnx.inliner.inline_local_functions"
        raise InvalidInput(f"the file holds local functions; {hint}", field=field)
    nodes = 0
    for message in _messages(model.graph, field):
        if isinstance(message, onnx.NodeProto):
            nodes += 1
            if nodes > MAX_NODES:
                raise InvalidInput("too many operators", field=field, value=f"more than {MAX_NODES}", limit=MAX_NODES)
            _require_plain_operator(message, field)
        elif isinstance(message, onnx.TensorProto):
            _require_own_data(message, field)
    return model


def operator_set(model: onnx.ModelProto) -> int:
    """Return the version of the standard operators; 0 if the model states none."""
    return max((entry.version for entry in model.opset_import if entry.domain in _STANDARD), default=0)


def is_quantized(model: onnx.ModelProto) -> bool:
    """Return True if the network computes with 8-bit integers: it holds operators that quantise."""
    return any(node.op_type in _QUANTIZED for node in model.graph.node)


def dimensions(value: onnx.ValueInfoProto) -> list[int | None]:
    """Return the fixed lengths of the axes, None for free ones; empty if the file states no shape."""
    return [axis.dim_value if axis.HasField("dim_value") else None for axis in value.type.tensor_type.shape.dim]


def _messages(message: Message, field: str, depth: int = 1) -> Iterator[Message]:
    """Yield every message inside a graph, including those of inner graphs; tensors are not entered."""
    if depth > MAX_DEPTH:
        raise InvalidInput("graphs within graphs", field=field, value=depth, limit=MAX_DEPTH)
    for descriptor, value in message.ListFields():
        if descriptor.message_type is None:
            continue
        for inner in (value,) if isinstance(value, Message) else value:
            yield inner
            if not isinstance(inner, onnx.TensorProto):
                yield from _messages(inner, field, depth + isinstance(inner, onnx.GraphProto))


def _require_plain_operator(node: onnx.NodeProto, field: str) -> None:
    if node.domain not in _STANDARD:
        value = f"{node.domain}.{node.op_type}"
        raise InvalidInput("an operator that is not of standard ONNX", field=field, value=value, limit="ai.onnx")
    if node.op_type in _ENDLESS:
        raise InvalidInput("an operator that may never end", field=field, value=node.op_type)
    if node.op_type in _RANDOM:
        message = "an operator that draws random numbers; results could not be reproduced"
        raise InvalidInput(message, field=field, value=node.op_type)


def _require_own_data(tensor: onnx.TensorProto, field: str) -> None:
    if tensor.external_data or tensor.data_location == onnx.TensorProto.EXTERNAL:
        raise InvalidInput("data in another file; save the network as one file", field=field, value=tensor.name)
    size = tensor.ByteSize()
    if min(tensor.dims, default=0) < 0 or math.prod(tensor.dims) > _ELEMENTS_PER_BYTE * size:
        shape = " × ".join(map(str, tensor.dims))
        message = "a tensor whose stated size exceeds its data"
        raise InvalidInput(message, field=field, value=f"{tensor.name}: {shape}", limit=f"{size} bytes")
