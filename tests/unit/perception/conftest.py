from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from valerie.perception.documents.function import FunctionDocument, parse_function  # noqa: E402
from valerie.perception.importing.function_file import function_file_bytes  # noqa: E402
from valerie.perception.networks.architectures import build_network  # noqa: E402

MEAN, STD = (0.4, 0.45, 0.5), (0.2, 0.25, 0.3)


def state_arrays(network: torch.nn.Module) -> dict[str, object]:
    """Parameters and buffers as numpy arrays, without the batch counters."""
    state = network.state_dict()
    return {name: value.numpy() for name, value in state.items() if not name.endswith("num_batches_tracked")}


@pytest.fixture
def write_function(tmp_path: Path) -> Callable[..., Path]:
    """Writes a function file with random weights: ``write_function("semantic-fpn-small", seed=1, ...)``."""

    def write(architecture: str = "semantic-fpn-small", *, seed: int = 0, name: str | None = None, **changes) -> Path:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            tensors = state_arrays(build_network(architecture))
        tensors.update(changes.pop("tensors", {}))
        for dropped in changes.pop("drop", ()):
            del tensors[dropped]
        named = changes.pop("named", architecture)
        fields = {"architecture": named, "mean": MEAN, "std": STD, "provenance": {"licence": "Apache-2.0"}}
        path = tmp_path / f"{name or architecture}.safetensors"
        path.write_bytes(function_file_bytes(tensors, **(fields | changes)))
        return path

    return write


def onnx_network(
    *,
    classes: int = 19,
    stride: int = 1,
    layout: str = "nchw",
    answer: str = "logits",
    size: tuple[int, int] | None = None,
    kind: int = 1,
    opset: int = 17,
    rank: int = 4,
) -> bytes:
    """A network without training: the class of a pixel is a tenth of its first channel, in 8-bit values.

    Logits are −(value − 10 c)² without the part that is the same for all classes c; labels are the rounded tenth.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    height, width = size or ("h", "w")
    ids = np.arange(classes, dtype=np.float32)
    weights = np.zeros((classes, 3, 1, 1), np.float32)
    weights[:, 0, 0, 0] = 20 * ids
    constants = {"weights": weights, "bias": -100 * ids**2, "ten": np.float32(10), "starts": np.int64([0]),
                 "ends": np.int64([1]), "axes": np.int64([1])}  # fmt: skip
    nodes = [helper.make_node("Cast", ["x"], ["float"], to=TensorProto.FLOAT)]
    value = "float"
    if layout == "nhwc":
        nodes.append(helper.make_node("Transpose", [value], ["planes"], perm=[0, 3, 1, 2]))
        value = "planes"
    if stride > 1:
        nodes.append(
            helper.make_node("AveragePool", [value], ["pooled"], kernel_shape=[stride] * 2, strides=[stride] * 2)
        )
        value = "pooled"
    if answer == "labels":
        nodes += [
            helper.make_node("Slice", [value, "starts", "ends", "axes"], ["first"]),
            helper.make_node("Div", ["first", "ten"], ["tenth"]),
            helper.make_node("Round", ["tenth"], ["rounded"]),
            helper.make_node("Cast", ["rounded"], ["ids"], to=TensorProto.INT64),
        ]
        if rank == 3:
            nodes.append(helper.make_node("Squeeze", ["ids", "axes"], ["y"]))
        else:
            nodes.append(helper.make_node("Identity", ["ids"], ["y"]))
        output = helper.make_tensor_value_info(
            "y", TensorProto.INT64, ["n", 1, "a", "b"] if rank == 4 else ["n", "a", "b"]
        )
    else:
        nodes.append(helper.make_node("Conv", [value, "weights", "bias"], ["scores"]))
        if layout == "nhwc":
            nodes.append(helper.make_node("Transpose", ["scores"], ["y"], perm=[0, 2, 3, 1]))
        else:
            nodes.append(helper.make_node("Identity", ["scores"], ["y"]))
        axes = ["n", classes, "a", "b"] if layout == "nchw" else ["n", "a", "b", classes]
        output = helper.make_tensor_value_info("y", TensorProto.FLOAT, axes)
    axes = ["n", 3, height, width] if layout == "nchw" else ["n", height, width, 3]
    graph = helper.make_graph(
        nodes,
        "tenths",
        [helper.make_tensor_value_info("x", kind, axes)],
        [output],
        [numpy_helper.from_array(np.asarray(values), name) for name, values in constants.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8, producer_name="tests"
    )
    onnx.checker.check_model(model)
    return model.SerializeToString()


@pytest.fixture
def write_onnx(tmp_path: Path) -> Callable[..., tuple[FunctionDocument, Path]]:
    """Writes such a network and its document: ``write_onnx({"engine": "openvino"}, stride=4)``."""

    def write(document: dict[str, Any] | None = None, *, data: bytes | None = None, **network: Any) -> Any:
        data = onnx_network(**network) if data is None else data
        path = tmp_path / "network.onnx"
        path.write_bytes(data)
        payload = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), "format": "onnx"}
        fields = {"name": "tenths", "kind": "onnx", "input": {"scale": 1}, **(document or {})}
        return parse_function(fields, payload=payload), path

    return write
