"""Open any function from its document and payload."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from valerie.errors import CorruptArtifact, InvalidInput, MissingDependency, NotFound
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.quiet import silence_libraries

if TYPE_CHECKING:
    from valerie.perception.running.engines.base import InferenceEngine


def open_function(
    document: FunctionDocument,
    payload: Path | None,
    *,
    threads: int = 1,
    device: str = "auto",
    addresses: Sequence[str] = (),
    digest: str | None = None,
) -> PerceptionFunction:
    """Load a function to predict with.

    Args:
        document: document of the function.
        payload: its file; None for kinds without one.
        threads: CPU threads of this process for the inference engine.
        device: device of the engine torch: ``auto`` uses a GPU if there is one; ``cpu``, ``cuda``, ``cuda:1``.
        addresses: allowed addresses of functions behind HTTP; see `valerie.addresses`.
        digest: digest of the function on its card; None: the document's. Functions that ship with VALERIE have the SHA-256
            of their file.

    Raises:
        NotFound: there is no file ``payload``.
        CorruptArtifact: the file is not the one that the document names.
        InvalidInput, UnknownName: the document and the file do not fit each other.
        MissingDependency: the engine is not installed; states how to install it.
    """
    if threads < 1:
        raise InvalidInput("at least one thread", field="threads", value=threads, limit="≥ 1")
    if document.payload is not None:
        require_payload(document, payload)
    silence_libraries()
    identity = digest or document.digest
    try:
        if document.kind == "http":
            from valerie.perception.running.http_function import HttpFunction

            return HttpFunction(document, allowed=addresses, digest=identity)
        if payload is None:
            raise InvalidInput(
                "the user makes the predictions of this function; nothing can be opened",
                field="kind",
                value=document.kind,
            )
        from valerie.perception.running.engine_function import EngineFunction

        engine = open_engine(document, payload, threads=threads, device=device)
        return EngineFunction(document, engine, digest=identity)
    except ModuleNotFoundError as error:
        raise _missing(error) from error


def open_engine(
    document: FunctionDocument, payload: Path, *, threads: int = 1, device: str = "auto"
) -> InferenceEngine:
    """Load a network into its document's engine.

    Raises:
        InvalidInput, UnknownName, MissingDependency: see `open_function`.
    """
    silence_libraries()
    try:
        return _engine(document, payload, threads=threads, device=device)
    except ModuleNotFoundError as error:
        raise _missing(error) from error


def _missing(error: ModuleNotFoundError) -> MissingDependency:
    extra = "huggingface" if error.name == "transformers" else "infer"
    return MissingDependency(f"{error.name} is not installed; install it with: pip install 'valerie[{extra}]'")


def _engine(document: FunctionDocument, payload: Path, *, threads: int, device: str) -> InferenceEngine:
    if document.engine == "torch":
        from valerie.perception.running.engines.modules import open_module
        from valerie.perception.running.engines.torch_engine import TorchEngine

        return TorchEngine(open_module(document, payload), document, threads=threads, device=device)
    if document.engine == "openvino":
        from valerie.perception.running.engines.openvino_engine import OpenVinoEngine

        return OpenVinoEngine(document, payload, threads=threads)
    from valerie.perception.running.engines.onnxruntime_engine import OnnxRuntimeEngine

    return OnnxRuntimeEngine(document, payload, threads=threads)


def require_payload(document: FunctionDocument, path: Path | None) -> None:
    """Refuse a file other than the one that the document names.

    Raises:
        NotFound: there is no file ``path``.
        CorruptArtifact: it has another digest.
    """
    if path is None:
        raise NotFound("payload of the function", document.name)
    try:
        with path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
    except FileNotFoundError:
        raise NotFound("function file", path.name) from None
    if sha256 != document.file.sha256:
        raise CorruptArtifact(
            f"{path.name} has digest {sha256[:12]}; {document.name} needs {document.file.sha256[:12]}"
        )
