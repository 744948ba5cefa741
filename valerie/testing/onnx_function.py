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
        entries: further entries of the document, e.g. ``engine``.

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
    graph = helper.make_graph(
        [helper.make_node("Conv", ["picture", "weights", "bias"], ["logits"], kernel_shape=[1, 1])],
        "small",
        [helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, *sides])],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, 2, *sides])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")],
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
