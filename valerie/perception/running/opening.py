"""From a document and its payload to a function that is ready to predict: the one way to open any function."""

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
    from valerie.perception.running.engines.base import Engine


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
        document: what it is.
        payload: its file; None for kinds without one.
        threads: CPU threads of this process for the inference engine.
        device: of the engine torch: ``auto`` takes a GPU where there is one; ``cpu``, ``cuda``, ``cuda:1``.
        addresses: where functions behind HTTP may be; see `valerie.perception.documents.addresses`.
        digest: what stands for the function on its card; None: the document's digest. Functions that ship with VALERIE
            are known by the SHA-256 of their file.

    Raises:
        NotFound: there is no file ``payload``.
        CorruptArtifact: the file is not the one that the document names.
        InvalidInput, UnknownName: the document and the file do not fit each other.
        MissingDependency: the engine is not installed; says how to install it.
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
                "predictions of this function are uploaded by its user", field="kind", value=document.kind
            )
        from valerie.perception.running.adapted import AdaptedFunction

        engine = _engine(document, payload, threads=threads, device=device)
        return AdaptedFunction(document, engine, digest=identity)
    except ModuleNotFoundError as error:
        extra = "huggingface" if error.name == "transformers" else "infer"
        raise MissingDependency(
            f"{error.name} is not installed; install it with: pip install 'valerie[{extra}]'"
        ) from error


def _engine(document: FunctionDocument, payload: Path, *, threads: int, device: str) -> Engine:
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
    """Refuse a file that is not the one that the document names.

    Raises:
        NotFound: there is no file ``path``.
        CorruptArtifact: it has another digest.
    """
    assert document.payload is not None
    if path is None:
        raise NotFound("payload of the function", document.name)
    try:
        with path.open("rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
    except FileNotFoundError:
        raise NotFound("function file", path.name) from None
    if found != document.payload.sha256:
        raise CorruptArtifact(
            f"{path.name} has digest {found[:12]}; {document.name} needs {document.payload.sha256[:12]}"
        )
