"""The network of any kind as ONNX: the user's own file, or one that is exported from torch into a folder of its own."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import onnx

from valerie.errors import InvalidInput
from valerie.perception.adaptation import Size
from valerie.perception.documents import FunctionDocument
from valerie.perception.engines.graph import whole_graph
from valerie.perception.onnx_files import check_onnx

#: Exported networks take sides that are multiples of this.
_STEP = 32


class NetworkFile:
    """Gives the graph for pieces of any size; between two of them nothing of it is in memory.

    Args:
        document: kind ``onnx``, ``network`` or ``huggingface``.
        payload: its file.

    Raises:
        InvalidInput, UnknownName: document and payload do not fit each other.
        MissingDependency: torch or transformers is needed and not installed.
    """

    def __init__(self, document: FunctionDocument, payload: Path) -> None:
        self.document = document
        self._folder: TemporaryDirectory[str] | None = None
        self._given = document.output
        if document.kind == "onnx":
            check_onnx(payload)
            self._path = payload
            return
        from valerie.perception.engines.export import export_onnx
        from valerie.perception.engines.modules import open_module

        module = open_module(document, payload)
        if getattr(module, "align_corners", False):
            self._given = document.output.model_copy(update={"align_corners": True})
        self._folder = TemporaryDirectory(prefix="valerie-onnx-")
        self._path = Path(self._folder.name) / "network.onnx"
        export_onnx(module, self._path)

    def graph(self, piece: Size, labels: Size) -> bytes:
        """The whole graph (see `whole_graph`) for these sizes, serialised.

        Raises:
            InvalidInput: the network does not take pieces of this size.
        """
        if self._folder is not None and (piece.height % _STEP or piece.width % _STEP):
            raise InvalidInput(
                "this engine takes sides that are multiples of 32",
                field="input.size, input.multiple_of",
                value=f"{piece.width} × {piece.height}",
                limit=_STEP,
            )
        model = onnx.load(self._path, load_external_data=False)
        made = whole_graph(
            model,
            taken=self.document.input,
            given=self._given,
            piece=piece,
            labels=labels,
            output=str(self.document.options.get("output", "")),
        )
        return made.SerializeToString()

    def close(self) -> None:
        """Remove what was exported."""
        if self._folder is not None:
            self._folder.cleanup()
