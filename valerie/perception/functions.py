"""From a document and its payload to a function that is ready to predict: the one way to open any function."""

from __future__ import annotations

import hashlib
from pathlib import Path

from valerie.errors import CorruptArtifact, InvalidInput, MissingDependency, NotFound
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents import FunctionDocument


def open_function(
    document: FunctionDocument, payload: Path | None, *, threads: int = 1, digest: str | None = None
) -> PerceptionFunction:
    """Load a function to predict with.

    Args:
        document: what it is.
        payload: its file; None for kinds without one.
        threads: CPU threads of this process for the inference engine.
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
        _require_payload(document, payload)
    identity = digest or document.digest
    try:
        if document.kind == "network" and document.engine == "torch":
            from valerie.perception.torch_function import TorchFunction

            assert payload is not None, "checked above"
            return TorchFunction(document, payload, threads=threads, digest=identity)
    except ModuleNotFoundError as error:
        raise MissingDependency(
            f"{error.name} is not installed; install it with: pip install 'valerie[infer]'"
        ) from error
    raise InvalidInput(
        "this version runs networks in torch alone",
        field="kind, engine",
        value=f"{document.kind}, {document.engine}",
        limit="network, torch",
    )


def _require_payload(document: FunctionDocument, path: Path | None) -> None:
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
