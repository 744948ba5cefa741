"""The functions that ship with VALERIE, by name; only loading one imports torch."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

from valerie.errors import UnknownName
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.perception.documents.function import FunctionDocument, InputDocument, Payload
from valerie.perception.importing.function_file import read_header
from valerie.perception.running.opening import open_function

#: Folder of the shipped function files.
WEIGHTS: Final = Path(__file__).parent / "weights"

#: Names of the functions that ship with VALERIE; each is the file ``weights/<name>.safetensors``.
FUNCTIONS: Final = ("deeplabv3plus-small", "semantic-fpn-small")

#: The coarsest stride of the networks: their sides are padded to multiples of it.
ALIGNMENT: Final = 32


def function_path(name: str, *, folder: Path = WEIGHTS, field: str = "function") -> Path:
    """Return the file of a shipped function.

    Raises:
        UnknownName: no such function; near matches are named.
    """
    if name not in FUNCTIONS:
        raise UnknownName("perception function", name, FUNCTIONS, field=field)
    return folder / f"{name}.safetensors"


def file_document(name: str, path: Path) -> FunctionDocument:
    """Return the document of a function file, from its header: fp32 in torch.

    See `valerie.perception.importing.function_file` for the format.

    Raises:
        NotFound, InvalidInput: the file is missing or damaged.
    """
    stamp = path.stat().st_mtime_ns if path.exists() else 0
    return _document(name, path, stamp)


def function_document(name: str, *, folder: Path = WEIGHTS) -> FunctionDocument:
    """Return the document of a shipped function, from its file's header; neither torch nor the weights are loaded.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    return file_document(name, function_path(name, folder=folder))


def function_card(name: str, *, folder: Path = WEIGHTS) -> FunctionCard:
    """Return the card of a shipped function; neither torch nor the weights are loaded.

    Raises:
        UnknownName, NotFound, InvalidInput: see `function_document`.
    """
    document = function_document(name, folder=folder)
    return document.card(digest=_identity(document))


def load_function(name: str, *, threads: int = 1, device: str = "auto", folder: Path = WEIGHTS) -> PerceptionFunction:
    """Load a shipped function to predict with.

    Args:
        name: one of `FUNCTIONS`.
        threads: CPU threads of this process for the inference engine.
        device: see `valerie.perception.running.opening.open_function`.
        folder: of the function files.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
        MissingDependency: torch is not installed.
    """
    path = function_path(name, folder=folder)
    document = file_document(name, path)
    return open_function(document, path, threads=threads, device=device, digest=_identity(document))


def _identity(document: FunctionDocument) -> str:
    """Return the digest that stands for a shipped function: that of its file, which holds all that its document says."""
    assert document.payload is not None, "a document of a file has a payload"
    return document.payload.sha256


@lru_cache(maxsize=64)  # hashing 8 MB costs 5 ms; the stamp makes a replaced file a new entry
def _document(name: str, path: Path, stamp: int) -> FunctionDocument:  # noqa: ARG001
    header = read_header(path)
    return FunctionDocument(
        name=name,
        kind="network",
        payload=Payload(sha256=header.digest, bytes=path.stat().st_size, format="safetensors"),
        architecture=header.architecture,
        input=InputDocument(multiple_of=ALIGNMENT, longest_side=header.longest_side, mean=header.mean, std=header.std),
        engine="torch",
        provenance=dict(header.provenance),
    )
