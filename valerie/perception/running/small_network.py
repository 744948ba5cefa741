"""The smallest function in one ONNX file, for probes of engines and for tests."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from valerie.errors import MissingDependency
from valerie.perception.documents.function import FunctionDocument, Payload


def small_onnx(folder: Path, *, name: str = "small", **entries: Any) -> tuple[FunctionDocument, Path]:
    """Write a network of one 1 × 1 convolution, for which dark pixels are persons and all others road.

    Args:
        folder: folder of the file ``<name>.onnx``.
        name: name of the function.
        entries: further entries of the document, e.g. ``engine``; with ``precision="int8"`` the network is quantised.

    Raises:
        MissingDependency: the library onnx is not installed.
    """
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ModuleNotFoundError as error:
        raise MissingDependency("onnx is not installed; install it with: pip install 'valerie[infer]'") from error
    weights = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]], np.float32).reshape(2, 3, 1, 1)
    bias = np.array([0.0, 1.5], np.float32)
    sides: list[Any] = ["height", "width"]
    constants = [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")]
    nodes, inputs = [], ["picture", "weights"]
    if entries.get("precision") == "int8":
        scales = [numpy_helper.from_array(np.array(1 / steps, np.float32), f"1/{steps}") for steps in (255, 127)]
        zero = numpy_helper.from_array(np.array(0, np.uint8), "0")
        eight_bits = numpy_helper.from_array((127 * weights).astype(np.int8), "weights")
        constants = [eight_bits, constants[1], *scales, zero]
        nodes = [
            helper.make_node("QuantizeLinear", ["picture", "1/255", "0"], ["picture, 8 bits"]),
            helper.make_node("DequantizeLinear", ["picture, 8 bits", "1/255", "0"], ["picture, rounded"]),
            helper.make_node("DequantizeLinear", ["weights", "1/127"], ["weights, rounded"]),
        ]
        inputs = ["picture, rounded", "weights, rounded"]
    graph = helper.make_graph(
        [*nodes, helper.make_node("Conv", [*inputs, "bias"], ["logits"], kernel_shape=[1, 1])],
        "small",
        [helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, *sides])],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, 2, *sides])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    data = model.SerializeToString(deterministic=True)
    onnx.checker.check_model(model)
    path = folder / f"{name}.onnx"
    path.write_bytes(data)
    payload = Payload(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data), format="onnx")
    document = FunctionDocument.model_validate(
        {"name": name, "kind": "onnx", "payload": payload, "output": {"classes": ["road", "person"]}, **entries}
    )
    return document, path
