"""Networks in OpenVINO: the fast engine on processors.

Two pictures share the threads, since the small layers of one picture keep only one and a half of two cores busy.

OpenVINO chooses bf16 by default on processors that have it. Here the precision is set and read back from the compiled model;
any other is refused.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import openvino
from numpy.typing import NDArray
from openvino import properties

from valerie.errors import InvalidInput, MissingDependency
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.base import Recent
from valerie.perception.running.engines.network_file import NetworkFile
from valerie.perception.running.engines.processor import instruction_set

#: What a quantised network does not compute in 8 bits is fp32.
_TYPES: Final = {
    "fp32": openvino.Type.f32,
    "bf16": openvino.Type.bf16,
    "fp16": openvino.Type.f16,
    "int8": openvino.Type.f32,
}
_DEVICE: Final = "CPU"
#: Most pictures at once. Each takes memory for the activations of a whole network.
_MOST_STREAMS: Final = 2


class OpenVinoEngine:
    """See `valerie.perception.running.engines.base.InferenceEngine`.

    Args:
        document: document of the function; states the precision.
        payload: its file.
        threads: CPU threads of this engine.

    Raises:
        MissingDependency: this processor does not compute in that precision.
        InvalidInput, UnknownName: see `NetworkFile`.
    """

    name: Final = "openvino"

    def __init__(self, document: FunctionDocument, payload: Path, *, threads: int) -> None:
        self.precision = document.precision
        _require_precision(self.precision)
        #: Pictures at once.
        self.batch_size = min(threads, _MOST_STREAMS)
        self._threads_each = threads // self.batch_size
        self._network = NetworkFile(document, payload)
        self._compiled = Recent(self._compile)
        self._streams = ThreadPoolExecutor(self.batch_size)

    @property
    def numeric_class(self) -> str:
        """E.g. ``openvino-2026.4.1-cpu-bf16-amx-t1``: with the threads of one picture."""
        version = openvino.get_version().partition("-")[0]
        return f"openvino-{version}-cpu-{self.precision}-{instruction_set()}-t{self._threads_each}"

    def answer(self, piece: NDArray[np.uint8]) -> NDArray[Any]:
        """See `Engine`."""
        size = Size(*piece.shape[:2])
        answer: NDArray[Any] = self._compiled.get(size, size)[0].infer([piece[None]])[0][0]
        return answer

    def ids(self, pieces: NDArray[np.uint8], labels: Size) -> NDArray[np.uint8]:
        """See `Engine`."""

        def ids_of(piece: NDArray[np.uint8], request: openvino.InferRequest) -> NDArray[np.uint8]:
            return self._network.ids(request.infer([piece[None]], share_outputs=True)[0][0], labels)

        requests = self._compiled.get(Size(*pieces.shape[1:3]), labels)
        return np.stack(list(self._streams.map(ids_of, pieces, requests)))

    def close(self) -> None:
        """Free the weights."""
        self._streams.shutdown()
        self._compiled.clear()
        del self._network

    def _compile(self, piece: Size, labels: Size) -> list[openvino.InferRequest]:
        graph = self._network.graph(piece, labels)
        try:
            core = _core()
            model = core.read_model(graph)
            compiled = core.compile_model(
                model, _DEVICE, _settings(self.precision, self._threads_each, self.batch_size)
            )
        except RuntimeError as error:
            raise InvalidInput(f"OpenVINO cannot run this network: {_reason(error)}", field="onnx") from error
        _require_compiled(compiled, self.precision)
        return [compiled.create_infer_request() for _ in range(self.batch_size)]


def _settings(precision: str, threads: int, streams: int) -> dict[str, openvino.OVAny]:
    hint = properties.hint
    mode = hint.ExecutionMode.ACCURACY if _TYPES[precision] == openvino.Type.f32 else hint.ExecutionMode.PERFORMANCE
    return {
        hint.inference_precision(): _TYPES[precision],
        # ACCURACY also keeps the engine from rounding weights or activations.
        hint.execution_mode(): mode,
        properties.inference_num_threads(): threads * streams,
        properties.num_streams(): streams,
        # Several workers share a machine; if pinned to the same cores, they would wait for each other.
        hint.enable_cpu_pinning(): False,
    }


@lru_cache(maxsize=1)
def _core() -> openvino.Core:
    return openvino.Core()


@lru_cache(maxsize=8)
def _require_precision(precision: str) -> None:
    """Compile a tiny network and read its precision back, since the list of capabilities is not reliable."""
    ops = openvino.opset13
    value = ops.parameter([1, 8, 8, 8], openvino.Type.f32)
    weights = ops.constant(np.ones((8, 8, 3, 3), np.float32))
    inputs = value, weights
    if precision == "int8":
        inputs = tuple(
            ops.fake_quantize(x, -1.0, 1.0, -1.0, 1.0, levels) for x, levels in ((value, 256), (weights, 255))
        )
    model = openvino.Model([ops.convolution(*inputs, [1, 1], [1, 1], [1, 1], [1, 1])], [value])
    _require_compiled(_core().compile_model(model, _DEVICE, _settings(precision, 1, 1)), precision)


def _require_compiled(compiled: openvino.CompiledModel, precision: str) -> None:
    """Refuse a compiled model of another precision."""
    compiled_type = compiled.get_property(properties.hint.inference_precision())
    if compiled_type != _TYPES[precision]:
        names = {kind.get_type_name(): name for name, kind in reversed(_TYPES.items())}
        name = names.get(compiled_type.get_type_name(), compiled_type.get_type_name())
        raise MissingDependency(f"OpenVINO computes in {name} on this processor, but {precision} is requested")
    if precision == "int8" and not any(map(_in_8_bits, compiled.get_runtime_model().get_ops())):
        raise MissingDependency("OpenVINO computes quantised networks in fp32 on this processor, but int8 is requested")


def _in_8_bits(operation: openvino.Node) -> bool:
    facts = operation.get_rt_info()
    kind, precision = (facts[name].astype(str) for name in ("layerType", "runtimePrecision"))
    return kind in ("Convolution", "FullyConnected", "MatMul") and precision in ("u8", "i8")


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
