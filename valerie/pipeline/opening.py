"""Opening a function by what people call it: an installed or registered name, or the path of a function file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from valerie import plugins
from valerie.db.engine import reading
from valerie.errors import InvalidInput, UnknownName
from valerie.perception.base import PerceptionFunction
from valerie.perception.catalog import FUNCTIONS, file_document, function_path
from valerie.perception.functions import open_function
from valerie.pipeline import functions
from valerie.pipeline.context import Context
from valerie.pipeline.function_source import FunctionSource

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


def open_reference(reference: str, *, context: Context, threads: int = 1) -> PerceptionFunction:
    """Load a function to predict with.

    Args:
        reference: a function file, the name of an installed function, ``name`` or ``name@digest`` of a registered one.
        context: of the deployment, where functions are registered.
        threads: CPU threads of this process for the inference engine.

    Raises:
        UnknownName, NotFound, InvalidInput, MissingDependency: as `plugins.create_function`, `open_function` and
            `valerie.pipeline.functions.find`.
    """
    if is_file(reference):
        path = Path(reference)
        return open_function(file_document(display_name(reference), path), path, threads=threads)
    installed = plugins.function_names(testing=context.settings.testing_engines)
    if reference in installed:
        return plugins.create_function(reference, threads=threads)
    with reading(context.engine) as connection:
        known = functions.names(connection, functions.known(connection, [reference]))
        if reference.partition("@")[0] not in known:
            raise UnknownName("function", reference, {*installed, *known}, field="function")
        document = functions.find(connection, reference).document
    return FunctionSource(context).open_document(document, threads=threads)
