"""Quantisation of networks: 8-bit weights and activations, whose ranges are those that given pictures bring about."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
import onnx
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import FunctionDocument, InputDocument, Payload
from valerie.perception.documents.options import OnnxOptions
from valerie.perception.running.adaptation import Size, plan
from valerie.perception.running.engines.network_file import NetworkFile
from valerie.perception.running.quiet import silence_libraries

#: Layers that take most of the time and lose little.
_LAYERS: Final = ["Conv"]


def quantize(
    document: FunctionDocument, payload: Path, pictures: Iterable[NDArray[np.uint8]]
) -> tuple[FunctionDocument, bytes]:
    """Return a function whose convolutions compute with 8-bit integers.

    Weights are quantised to 7 bits per channel, symmetrically around 0; activations to 8 bits over the range of their values for
    the pictures.

    Args:
        document: document of kind ``network`` or ``onnx``.
        payload: its file.
        pictures: (H, W, 3) uint8 sRGB frames of one size, at least one.

    Returns:
        The document, of kind ``onnx`` and precision ``int8``, and its file.

    Raises:
        InvalidInput: a function of another kind, one that is quantised already, or a network that cannot be quantised.
    """
    if document.kind not in ("network", "onnx"):
        limit = "kind network or onnx; export others to ONNX first"
        raise InvalidInput("functions of this kind cannot be quantised", field="kind", value=document.kind, limit=limit)
    if document.precision == "int8":
        raise InvalidInput("the function is quantised already", field="precision", value=document.precision)
    silence_libraries()
    network = NetworkFile(document.model_copy(update={"engine": "onnxruntime", "precision": "fp32"}), payload)
    data = _quantized(network, pictures)
    entries = {
        "kind": "onnx",
        "engine": "openvino",
        "precision": "int8",
        "output": network.output,
        "options": document.options if document.kind == "onnx" else OnnxOptions(),
        "payload": Payload(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data), format="onnx"),
    }
    return document.model_copy(update=entries), data


def _quantized(network: NetworkFile, pictures: Iterable[NDArray[np.uint8]]) -> bytes:
    from onnxruntime import quantization

    inputs = _inputs(network.document.input, pictures)
    first = next(inputs)
    size = Size(*(first.shape[2:] if network.document.input.layout == "nchw" else first.shape[1:3]))

    feeds = chain([first], inputs)

    class Reader(quantization.CalibrationDataReader):  # type: ignore[misc]  # onnxruntime has no types
        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            value = next(feeds, None)
            return None if value is None else {name: value}

    with TemporaryDirectory(prefix="valerie-quantize-") as folder:
        fused, quantized = Path(folder, "fused.onnx"), Path(folder, "quantized.onnx")
        try:
            quantization.quant_pre_process(
                onnx.load_from_string(network.network(size)), fused, skip_symbolic_shape=True
            )
            name = onnx.load(fused).graph.input[0].name
            quantization.quantize_static(
                fused,
                quantized,
                Reader(),
                op_types_to_quantize=_LAYERS,
                per_channel=True,
                # Weights of 7 bits: without VNNI, processors add two products in 16 bits, which 8 bits overflow.
                reduce_range=True,
                activation_type=quantization.QuantType.QUInt8,
                weight_type=quantization.QuantType.QInt8,
            )
        except Exception as error:  # onnxruntime raises errors of every kind
            reason = str(error).strip().partition("\n")[0]
            raise InvalidInput(f"the network cannot be quantised: {reason}", field="payload") from error
        return quantized.read_bytes()


def _inputs(document: InputDocument, pictures: Iterable[NDArray[np.uint8]]) -> Iterator[NDArray[np.float32]]:
    """Yield the network's input, float32, for every piece of every picture."""
    mean, std = (document.value_range * np.array(values, np.float32) for values in (document.mean, document.std))
    for picture in pictures:
        for piece in plan(document, *picture.shape[:2]).pieces(picture):
            ordered = piece[..., ::-1] if document.channel_order == "bgr" else piece
            values = ((ordered.astype(np.float32) - mean) / std)[None]
            yield np.ascontiguousarray(values.transpose(0, 3, 1, 2) if document.layout == "nchw" else values)
