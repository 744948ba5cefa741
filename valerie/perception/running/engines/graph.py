"""Completion of an ONNX network to one graph: 8-bit pictures of one size in, logits or ids of classes out.

Both ONNX engines run the same graph, so they differ only in kernels. The graph adds channel order, normalisation and memory
layout before the network. Logits of several classes are returned in the network's own resolution (see `upsampled_ids`).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from valerie.errors import InvalidInput
from valerie.perception.documents.function import InputDocument, OutputDocument
from valerie.perception.importing.onnx_files import dimensions
from valerie.perception.running.adaptation import Size

#: Names of the whole graph's input and output.
PICTURES: Final = "valerie.pictures"
ANSWER: Final = "valerie.answer"
#: First version whose Resize states the position of pixel centres.
MIN_OPSET: Final = 11

_FLOATS: Final = (TensorProto.FLOAT, TensorProto.FLOAT16)


def whole_graph(
    model: onnx.ModelProto,
    *,
    source: InputDocument,
    answer: OutputDocument,
    piece: Size,
    labels: Size,
    output: str = "",
) -> onnx.ModelProto:
    """Surround a network with the steps from pixels to its input and from its output to labels.

    Args:
        model: network with one input, (1, 3, h, w) or (1, h, w, 3); changed in place.
        source, answer: input and output of the document.
        piece: height and width of the pictures.
        labels: height and width of the label map.
        output: name of the output with the result; empty: the first.

    Returns:
        A graph from `PICTURES` (1, h, w, 3) uint8 to `ANSWER`: for several classes their logits or probabilities (1, C, rows,
        columns) float32 in the network's resolution; for one class, or a network that returns labels, ids (1, height, width)
        uint8.

    Raises:
        InvalidInput: the network has another number of inputs or classes, or another size, than the document.
    """
    graph = model.graph
    opset = next((entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")), 0)
    if opset < MIN_OPSET:
        raise InvalidInput("the operator set is too old", field="onnx", value=opset, limit=f"≥ {MIN_OPSET}")
    builder = _Builder(opset)
    pictures = _input(graph)
    result = _output(graph, output)
    _require_size(pictures, source, piece)
    _preprocessing(builder, pictures, source)
    split = len(builder.nodes)
    _postprocessing(builder, result, answer, source.layout, labels)
    network = list(graph.node)
    del graph.node[:]
    graph.node.extend([*builder.nodes[:split], *network, *builder.nodes[split:]])
    graph.initializer.extend(builder.constants)
    del graph.input[:]
    graph.input.append(helper.make_tensor_value_info(PICTURES, TensorProto.UINT8, [1, *piece, 3]))
    del graph.output[:]
    graph.output.append(_answer_info(answer, labels))
    # The exporter's sizes of inner values may refer to the removed input.
    del graph.value_info[:]
    return model


def _answer_info(answer: OutputDocument, labels: Size) -> onnx.ValueInfoProto:
    if answer.kind == "labels" or len(answer.classes) == 1:
        return helper.make_tensor_value_info(ANSWER, TensorProto.UINT8, [1, *labels])
    return helper.make_tensor_value_info(ANSWER, TensorProto.FLOAT, [1, len(answer.classes), "rows", "columns"])


class _Builder:
    """A collection of nodes and constants with unique names."""

    def __init__(self, opset: int) -> None:
        self.opset = opset
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []
        self._count = 0

    def one(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """Add a node with one output and return the output's name."""
        self._count += 1
        name = name or f"valerie.{self._count}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], name=f"valerie.{self._count}", **attributes))
        return name

    def constant(self, values: NDArray[Any]) -> str:
        """Add a constant and return its name."""
        name = f"valerie.constant.{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(values, name))
        return name

    def integers(self, *values: int) -> str:
        """Add a vector of int64 and return its name."""
        return self.constant(np.array(values, np.int64))

    def number(self, value: float) -> str:
        """Add a float32 and return its name."""
        return self.constant(np.array(value, np.float32))

    def unsqueezed(self, value: str, axis: int) -> str:
        """Add an axis of length 1; before opset 13 the axis is an attribute."""
        if self.opset < 13:
            return self.one("Unsqueeze", value, axes=[axis])
        return self.one("Unsqueeze", value, self.integers(axis))

    def squeezed(self, value: str, axis: int) -> str:
        """Remove an axis of length 1."""
        if self.opset < 13:
            return self.one("Squeeze", value, axes=[axis])
        return self.one("Squeeze", value, self.integers(axis))

    def resized(self, value: str, channels: int, size: Size, **attributes: str) -> str:
        """Resample (1, C, h, w) to (1, C, height, width)."""
        nothing = self.constant(np.zeros(0, np.float32))
        return self.one("Resize", value, nothing, nothing, self.integers(1, channels, *size), **attributes)


def _input(graph: onnx.GraphProto) -> onnx.ValueInfoProto:
    constants = {tensor.name for tensor in graph.initializer}
    inputs: list[onnx.ValueInfoProto] = [value for value in graph.input if value.name not in constants]
    if len(inputs) != 1:
        names = ", ".join(value.name for value in inputs) or "none"
        raise InvalidInput("a network with one input is needed", field="onnx.inputs", value=names)
    kind = inputs[0].type.tensor_type.elem_type
    if kind not in (*_FLOATS, TensorProto.UINT8):
        name = TensorProto.DataType.Name(kind)
        raise InvalidInput(
            "the input has another type", field="onnx.inputs", value=name, limit="FLOAT, FLOAT16 or UINT8"
        )
    network_input: onnx.ValueInfoProto = inputs[0]
    return network_input


def _output(graph: onnx.GraphProto, name: str) -> onnx.ValueInfoProto:
    outputs: list[onnx.ValueInfoProto] = list(graph.output)
    for value in outputs:
        if name in ("", value.name):
            return value
    names = ", ".join(value.name for value in outputs)
    raise InvalidInput("the network has no such output", field="options.output", value=name, limit=names)


def _require_size(source: onnx.ValueInfoProto, document: InputDocument, piece: Size) -> None:
    axes = dimensions(source)
    shape = [1, 3, *piece] if document.layout == "nchw" else [1, *piece, 3]
    if axes and (len(axes) != 4 or any(has not in (None, want) for has, want in zip(axes, shape, strict=True))):
        text = " × ".join("free" if axis is None else str(axis) for axis in axes)
        limit = " × ".join(map(str, shape))
        raise InvalidInput(
            "the network takes another input; check input.size and input.layout",
            field="onnx",
            value=text,
            limit=limit,
        )


def _preprocessing(builder: _Builder, source: onnx.ValueInfoProto, document: InputDocument) -> None:
    value = PICTURES
    kind = source.type.tensor_type.elem_type
    if document.channel_order == "bgr":
        value = builder.one("Gather", value, builder.integers(2, 1, 0), axis=3)
    value = builder.one("Cast", value, to=TensorProto.FLOAT)
    mean = document.value_range * np.array(document.mean, np.float32)
    std = document.value_range * np.array(document.std, np.float32)
    shape = (1, 1, 1, 3)
    if document.layout == "nchw":
        value = builder.one("Transpose", value, perm=[0, 3, 1, 2])
        shape = (1, 3, 1, 1)
    if mean.any():
        value = builder.one("Sub", value, builder.constant(mean.reshape(shape)))
    if (std != 1.0).any():
        value = builder.one("Div", value, builder.constant(std.reshape(shape)))
    builder.one("Cast", value, to=kind, name=source.name)


def _postprocessing(
    builder: _Builder, result: onnx.ValueInfoProto, answer: OutputDocument, layout: str, labels: Size
) -> None:
    axes = dimensions(result)
    if answer.kind == "labels":
        _ids_of_labels(builder, result.name, len(axes), labels)
        return
    value = builder.one("Cast", result.name, to=TensorProto.FLOAT)
    count = len(answer.classes)
    if len(axes) == 3 and count == 1:
        value, axes = builder.unsqueezed(value, 1), [axes[0], 1, *axes[1:]]
    elif layout == "nhwc":
        value = builder.one("Transpose", value, perm=[0, 3, 1, 2])
        axes = [axes[0], axes[3], axes[1], axes[2]] if len(axes) == 4 else axes
    if axes and (len(axes) != 4 or axes[1] not in (None, count)):
        text = " × ".join("free" if axis is None else str(axis) for axis in axes)
        raise InvalidInput(
            "the network answers another number of classes than the document lists",
            field="output.classes",
            value=text,
            limit=f"1 × {count} × height × width",
        )
    if count > 1:
        builder.one("Identity", value, name=ANSWER)
        return
    mode = "align_corners" if answer.align_corners else "half_pixel"
    full = builder.resized(value, 1, labels, mode="linear", coordinate_transformation_mode=mode)
    above = builder.one("Greater", builder.squeezed(full, 1), builder.number(answer.cut))
    ids = builder.one("Where", above, builder.number(0.0), builder.number(255.0))
    builder.one("Cast", ids, to=TensorProto.UINT8, name=ANSWER)


def _ids_of_labels(builder: _Builder, value: str, rank: int, labels: Size) -> None:
    """Resample ids (1, h, w) or (1, 1, h, w) of any number type to the nearest pixel; ids outside 0…255 become void."""
    value = builder.one("Cast", value, to=TensorProto.FLOAT)
    if rank != 4:
        value = builder.unsqueezed(value, 1)
    value = builder.resized(
        value,
        1,
        labels,
        mode="nearest",
        coordinate_transformation_mode="half_pixel",
        nearest_mode="round_prefer_ceil",
    )
    void = builder.number(255.0)
    below = builder.one("Less", value, builder.number(0.0))
    value = builder.one("Where", below, void, builder.one("Min", value, void))
    builder.one("Cast", builder.squeezed(value, 1), to=TensorProto.UINT8, name=ANSWER)
