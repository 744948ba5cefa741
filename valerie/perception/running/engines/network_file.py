"""Networks of any kind as ONNX: the user's own file, or an export from torch in a folder of its own."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import onnx

from valerie.perception.documents.function import FunctionDocument
from valerie.perception.documents.options import OnnxOptions
from valerie.perception.importing.onnx_files import read_onnx
from valerie.perception.running.adaptation import Size
from valerie.perception.running.engines.graph import whole_graph

if TYPE_CHECKING:
    from torch import nn


class NetworkFile:
    """An ONNX network whose graph is built for pieces of any size; the network itself stays on disk.

    Args:
        document: of kind ``onnx``, ``network`` or ``huggingface``.
        payload: its file.

    Raises:
        InvalidInput, UnknownName: document and payload do not fit each other.
        MissingDependency: torch or transformers is needed but not installed.
    """

    def __init__(self, document: FunctionDocument, payload: Path) -> None:
        self.document = document
        self._path = payload
        self._output = document.output
        self._folder: TemporaryDirectory[str] | None = None
        #: A module that has to be exported again for every size; None otherwise.
        self._module: nn.Module | None = None
        if document.kind == "onnx":
            read_onnx(payload)
        else:
            self._export(payload)

    def graph(self, piece: Size, labels: Size) -> bytes:
        """Return the whole graph (see `whole_graph`) for these sizes, serialised.

        Raises:
            InvalidInput: the network is not that of the document, or does not take pieces of this size.
        """
        if self._module is not None:
            from valerie.perception.running.engines.export import export_onnx

            export_onnx(self._module, self._path, piece)
        model = whole_graph(
            onnx.load(self._path, load_external_data=False),
            source=self.document.input,
            answer=self._output,
            piece=piece,
            labels=labels,
            output=options.output if isinstance(options := self.document.options, OnnxOptions) else "",
        )
        graph: bytes = model.SerializeToString()
        return graph

    def close(self) -> None:
        """Remove the export."""
        self._module = None
        if self._folder is not None:
            self._folder.cleanup()

    def _export(self, payload: Path) -> None:
        from valerie.perception.running.engines.export import export_onnx, looks_at_size
        from valerie.perception.running.engines.modules import open_module

        module = open_module(self.document, payload)
        if getattr(module, "align_corners", False):
            self._output = self._output.model_copy(update={"align_corners": True})
        self._folder = TemporaryDirectory(prefix="valerie-onnx-")
        self._path = Path(self._folder.name) / "network.onnx"
        # The code of other people's networks may look at sizes in ways that a trace does not notice.
        if self.document.kind == "network" and not looks_at_size(module):
            export_onnx(module, self._path, None)
        else:
            self._module = module
