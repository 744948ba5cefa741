"""The functions that ship with VALERIE, by name. Nothing here imports torch until a function is loaded."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

from valerie.errors import UnknownName
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.perception.documents.function import FunctionDocument, InputDocument, Payload
from valerie.perception.importing.function_file import read_header
from valerie.perception.running.choice import AUTO, local_choice
from valerie.perception.running.opening import open_function

#: Folder of the shipped function files.
WEIGHTS: Final = Path(__file__).parent / "weights"

#: Names of the functions that ship with VALERIE; each is the file ``weights/<name>.safetensors``.
FUNCTIONS: Final = ("deeplabv3plus-small", "semantic-fpn-small")

#: The coarsest stride of the networks; sides are padded to multiples of it.
ALIGNMENT: Final = 32


def function_path(name: str, *, folder: Path = WEIGHTS) -> Path:
    """Return the file of a shipped function.

    Raises:
        UnknownName: no such function; near matches are named.
    """
    if name not in FUNCTIONS:
        raise UnknownName("perception function", name, FUNCTIONS, field="function")
    return folder / f"{name}.safetensors"


def file_document(name: str, path: Path) -> FunctionDocument:
    """Return the document of a function file, from its header, for the reference: fp32 in torch.

    See `valerie.perception.importing.function_file` for the format, and `local_document` for the fastest engine.

    Raises:
        NotFound, InvalidInput: the file is missing or damaged.
    """
    stamp = path.stat().st_mtime_ns if path.exists() else 0
    return _document(name, path, stamp)


def local_document(name: str, path: Path, *, device: str = "auto", precision: str = AUTO) -> FunctionDocument:
    """Return the document of a function file for the engine that runs it fastest on this machine.

    Args:
        name: name of the function.
        path: its file.
        device: see `valerie.perception.running.opening.open_function`.
        precision: see `valerie.perception.running.choice.local_choice`.

    Raises:
        NotFound, InvalidInput: the file is missing or damaged.
    """
    return local_choice(device, precision).applied(file_document(name, path))


def function_document(name: str, *, folder: Path = WEIGHTS) -> FunctionDocument:
    """Return the document of a shipped function, from its file's header; no engine and no weights are loaded.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    return local_document(name, function_path(name, folder=folder))


def function_card(name: str, *, folder: Path = WEIGHTS) -> FunctionCard:
    """Return the card of a shipped function; no engine and no weights are loaded.

    Raises:
        UnknownName, NotFound, InvalidInput: see `function_document`.
    """
    document = function_document(name, folder=folder)
    return document.card(digest=document.file.sha256)


def load_function(
    name: str, *, threads: int = 1, device: str = "auto", precision: str = AUTO, folder: Path = WEIGHTS
) -> PerceptionFunction:
    """Load a shipped function to predict with, in the engine that is fastest here.

    Args:
        name: one of `FUNCTIONS`.
        threads: CPU threads of this process for the inference engine.
        device: see `valerie.perception.running.opening.open_function`.
        precision: see `local_document`.
        folder: folder of the function files.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
        MissingDependency: torch is not installed, or this machine does not compute in that precision.
    """
    path = function_path(name, folder=folder)
    document = local_document(name, path, device=device, precision=precision)
    return open_function(document, path, threads=threads, device=device, digest=document.file.sha256)


@lru_cache(maxsize=64)  # hashing 8 MB takes 5 ms; the stamp makes a replaced file a new entry
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
