"""Networks of any kind as ONNX: the user's own file, or an export from torch."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
from numpy.typing import NDArray

from valerie.errors import InvalidInput
from valerie.perception.documents.function import FunctionDocument, OutputDocument
from valerie.perception.documents.options import OnnxOptions
from valerie.perception.importing.onnx_files import is_quantized, read_onnx
from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.graph import whole_graph
from valerie.perception.running.engines.upsampling import upsampled_ids

#: What builds the networks of a kind.
_LIBRARIES: Final = {"network": ("torch",), "huggingface": ("torch", "transformers")}


class NetworkFile:
    """An ONNX network whose graph can be built for pieces of any size.

    A torch network is built and exported with its first graph: torch takes seconds to import, and a worker that starts only
    asks for the engine's numeric class.

    Args:
        document: document of kind ``onnx``, ``network`` or ``huggingface``.
        payload: its file.

    Raises:
        InvalidInput: precision int8 of a network that is not quantised, or any other precision of one that is.
        ModuleNotFoundError: torch or transformers is needed but not installed.
    """

    def __init__(self, document: FunctionDocument, payload: Path) -> None:
        self.document = document
        self._payload = payload
        if document.kind == "onnx":
            _require_stated(document.precision, quantized=is_quantized(read_onnx(payload)))
        for library in _LIBRARIES.get(document.kind, ()):
            if find_spec(library) is None:
                raise ModuleNotFoundError(f"No module named {library!r}", name=library)

    @property
    def output(self) -> OutputDocument:
        """Output of the document, with the network's own ``align_corners``."""
        return self._opened[0]

    def network(self, piece: Size) -> bytes:
        """Return the network alone, as ONNX, for pieces of a size.

        Raises:
            InvalidInput, UnknownName: document and payload do not fit each other.
        """
        return self._opened[1](piece)

    def graph(self, piece: Size, labels: Size) -> bytes:
        """Return the whole graph (see `whole_graph`) for these sizes, serialised.

        Raises:
            InvalidInput, UnknownName: the network does not fit the document or does not accept pieces of this size.
        """
        model = whole_graph(
            onnx.load_from_string(self.network(piece)),
            source=self.document.input,
            answer=self.output,
            piece=piece,
            labels=labels,
            output=options.output if isinstance(options := self.document.options, OnnxOptions) else "",
        )
        graph: bytes = model.SerializeToString()
        return graph

    def ids(self, answer: NDArray[Any], labels: Size) -> NDArray[np.uint8]:
        """Return the ids (height, width) from the graph's output for one piece, without its first axis.

        Raises:
            InvalidInput: the network returns another number of classes than the document lists.
        """
        if answer.dtype == np.uint8:
            return answer
        if len(answer) != len(self.output.classes):
            raise InvalidInput(
                "the network answers another number of classes than the document lists",
                field="output.classes",
                value=len(self.output.classes),
                limit=len(answer),
            )
        return upsampled_ids(answer, labels, align_corners=self.output.align_corners)

    @cached_property
    def _opened(self) -> tuple[OutputDocument, Callable[[Size], bytes]]:
        output = self.document.output
        if self.document.kind == "onnx":
            return output, lambda _: self._payload.read_bytes()
        from valerie.perception.running.engines.export import export_onnx, looks_at_size
        from valerie.perception.running.engines.modules import open_module

        module = open_module(self.document, self._payload)
        if getattr(module, "align_corners", False):
            output = output.model_copy(update={"align_corners": True})
        # Networks from elsewhere may branch on sizes in ways that a trace does not show.
        if self.document.kind != "network" or looks_at_size(module):
            return output, lambda piece: export_onnx(module, piece)
        network = export_onnx(module, None)
        return output, lambda _: network


def _require_stated(precision: str, *, quantized: bool) -> None:
    """Refuse a document whose precision is not that of the file."""
    if quantized and precision != "int8":
        raise InvalidInput("the network is quantised", field="precision", value=precision, limit="int8")
    if precision == "int8" and not quantized:
        hint = "the network is not quantised; `valerie function quantize` makes one that is"
        raise InvalidInput(hint, field="precision", value=precision, limit="fp32, bf16 or fp16")
