"""Perception functions by name; only loading one imports torch."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

from valerie.errors import MissingDependency, UnknownName
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.perception.function_file import read_header

#: Where the shipped function files are.
WEIGHTS: Final = Path(__file__).parent / "weights"

#: Names of the functions that ship with VALERIE; each is the file ``weights/<name>.safetensors``.
FUNCTIONS: Final = ("deeplabv3plus-small", "semantic-fpn-small")

#: What the built-in functions run in, known without importing it.
ENGINE: Final = "torch"
PRECISION: Final = "fp32"


def function_path(name: str, *, folder: Path = WEIGHTS, field: str = "function") -> Path:
    """The file of a function.

    Raises:
        UnknownName: no such function; near matches are named.
    """
    if name not in FUNCTIONS:
        raise UnknownName("perception function", name, FUNCTIONS, field=field)
    return folder / f"{name}.safetensors"


def function_card(name: str, *, folder: Path = WEIGHTS) -> FunctionCard:
    """What is known of a function, from its file's header; neither torch nor the weights are loaded.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    path = function_path(name, folder=folder)
    stamp = path.stat().st_mtime_ns if path.exists() else 0
    return _card(name, path, stamp)


def load_function(name: str, *, threads: int = 1, folder: Path = WEIGHTS) -> PerceptionFunction:
    """Load a function to predict with.

    Args:
        name: one of `FUNCTIONS`.
        threads: CPU threads of this process for torch.
        folder: where the function files are.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
        MissingDependency: torch is not installed.
    """
    path = function_path(name, folder=folder)
    try:
        from valerie.perception.torch_function import TorchFunction
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise MissingDependency("torch is not installed; install it with: pip install 'valerie[infer]'") from error
    return TorchFunction(name, path, threads=threads)


@lru_cache(maxsize=64)  # hashing 8 MB costs 5 ms; the stamp makes a replaced file a new entry
def _card(name: str, path: Path, stamp: int) -> FunctionCard:  # noqa: ARG001
    return read_header(path).card(name, precision=PRECISION, engine=ENGINE)
