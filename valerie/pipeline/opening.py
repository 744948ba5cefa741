"""Opening a function by what people call it: a name, or the path of a function file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from valerie import plugins
from valerie.errors import InvalidInput
from valerie.perception.base import PerceptionFunction
from valerie.perception.catalog import FUNCTIONS, file_document, function_path
from valerie.perception.functions import open_function

_SUFFIX: Final = ".safetensors"


def is_file(reference: str) -> bool:
    """Whether a reference means a file: it has a folder in it or ends as a function file does."""
    return "/" in reference or reference.endswith(_SUFFIX)


def function_file(reference: str) -> Path:
    """The file behind a reference: a path, or the name of a function that ships with VALERIE.

    Raises:
        InvalidInput: the function of that name is no file here.
    """
    if is_file(reference):
        return Path(reference)
    if reference not in FUNCTIONS:
        raise InvalidInput(
            "not a function whose weights are at hand",
            field="function",
            value=reference,
            limit=f"{', '.join(FUNCTIONS)}, or a function file (….safetensors)",
        )
    return function_path(reference)


def display_name(reference: str) -> str:
    """What results call it."""
    return re.sub(r"[^a-z0-9_.-]+", "-", Path(reference).stem.lower()).strip("-.") if is_file(reference) else reference


def open_reference(reference: str, *, threads: int = 1) -> PerceptionFunction:
    """Load a function to predict with.

    Raises:
        UnknownName, NotFound, InvalidInput, MissingDependency: as `plugins.create_function` and `open_function`.
    """
    if not is_file(reference):
        return plugins.create_function(reference, threads=threads)
    path = Path(reference)
    return open_function(file_document(display_name(reference), path), path, threads=threads)
