"""Networks in onnxruntime: fp32, or int8 of quantised files, on the CPU, independent of torch and OpenVINO."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.base import Recent
from valerie.perception.running.engines.graph import PICTURES
from valerie.perception.running.engines.network_file import NetworkFile
from valerie.perception.running.engines.processor import instruction_set


class OnnxRuntimeEngine:
    """See `valerie.perception.running.engines.base.InferenceEngine`.

    Args:
        document: document of the function.
        payload: its file.
        threads: CPU threads of this engine.

    Raises:
        InvalidInput, UnknownName: see `NetworkFile`.
    """

    name: Final = "onnxruntime"
    batch_size: Final = 1

    def __init__(self, document: FunctionDocument, payload: Path, *, threads: int) -> None:
        # `silence_libraries` stops events from being sent; this also stops them from being collected.
        onnxruntime.disable_telemetry_events()
        self.precision = document.precision
        self._threads = threads
        self._network = NetworkFile(document, payload)
        self._compiled = Recent(self._compile)

    @property
    def numeric_class(self) -> str:
        """E.g. ``onnxruntime-1.31.1-cpu-fp32-avx512-vnni-t2``."""
        version = onnxruntime.__version__
        return f"onnxruntime-{version}-cpu-{self.precision}-{instruction_set()}-t{self._threads}"

    def answer(self, piece: NDArray[np.uint8]) -> NDArray[Any]:
        """See `Engine`."""
        size = Size(*piece.shape[:2])
        answer: NDArray[Any] = self._compiled.get(size, size).run(None, {PICTURES: piece[None]})[0][0]
        return answer

    def ids(self, pieces: NDArray[np.uint8], labels: Size) -> NDArray[np.uint8]:
        """See `Engine`."""
        session = self._compiled.get(Size(*pieces.shape[1:3]), labels)
        answers = (session.run(None, {PICTURES: piece[None]})[0][0] for piece in pieces)
        return np.stack([self._network.ids(answer, labels) for answer in answers])

    def close(self) -> None:
        """Free the weights."""
        self._compiled.clear()
        del self._network

    def _compile(self, piece: Size, labels: Size) -> onnxruntime.InferenceSession:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self._threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        # Memory of a frame is freed, so that a waiting worker holds only the weights.
        options.enable_cpu_mem_arena = False
        # Waiting threads sleep: the machine is shared.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        graph = self._network.graph(piece, labels)
        try:
            return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # its classes derive from Exception and are private
            reason = str(error).strip().partition("\n")[0]
            raise InvalidInput(f"onnxruntime cannot run this network: {reason}", field="onnx") from error
