"""Functions by the references in commands: an installed or registered name, or the path of a function file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from valerie import plugins
from valerie.db.engine import reading
from valerie.db.functions import SHORT
from valerie.errors import Conflict, InvalidInput, TransientError, UnknownName
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.opening import open_function
from valerie.perception.shipped import FUNCTIONS, file_document, function_path, local_document
from valerie.perception.training.start_weights import require_trainable
from valerie.pipeline.base.context import Context
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.bounded import BoundedFunction, open_bounded
from valerie.pipeline.functions.loader import FunctionLoader
from valerie.pipeline.functions.opening import open_installed
from valerie.runs.products.pins import FunctionPin
from valerie.spelling import plain_name

_SUFFIX: Final = ".safetensors"


def is_file(reference: str) -> bool:
    """Return True if a reference is a file: it contains a folder or has the suffix of function files."""
    return "/" in reference or reference.endswith(_SUFFIX)


def pinned_network(name: str, pin: FunctionPin, *, context: Context) -> tuple[FunctionDocument, Path]:
    """Return document and weights of a network of VALERIE's own architectures as a run pinned it.

    Raises:
        InvalidInput: training cannot start from it (see `require_trainable`).
        NotFound, Conflict: see `pinned_payload`.
    """
    document, file = pinned_payload(name, pin, context=context)
    require_trainable(document)
    return document, file


def pinned_payload(name: str, pin: FunctionPin, *, context: Context) -> tuple[FunctionDocument, Path]:
    """Return document and file of a function as a run pinned it.

    Args:
        name: name in the run's spec.
        pin: pin of the run.
        context: context of the deployment in which functions are registered.

    Raises:
        InvalidInput: it has no file: it is a program, a network elsewhere, or predictions made elsewhere.
        NotFound: this version was removed.
        Conflict: it ships with VALERIE, and the run used other weights than those installed now.
    """
    if pin.kind is not None:
        with reading(context.engine) as connection:
            document = registry.of_digest(connection, pin.digest, name).document
        if document.payload is None:
            raise InvalidInput(f"functions of kind {document.kind} have no file", field="function", value=name)
        return document, FunctionLoader(context).file(document)
    if name not in FUNCTIONS:
        raise InvalidInput("a program of an installed package has no file", field="function", value=name)
    path = function_path(name)
    runs_as = {"engine": pin.card.engine, "precision": pin.card.precision}
    document = file_document(name, path).model_copy(update=runs_as)
    if document.file.sha256 != pin.digest:
        raise Conflict(
            f"the run used other weights of {name} ({pin.digest[:SHORT]}) than are installed now "
            f"({document.file.sha256[:SHORT]}); run the validation again"
        )
    return document, path


def display_name(reference: str) -> str:
    """Return the name that a reference has in results."""
    return plain_name(Path(reference).stem.lower(), also="_.", longest=64) if is_file(reference) else reference


def open_pinned(name: str, pin: FunctionPin, *, context: Context, threads: int | None = None) -> BoundedFunction:
    """Load exactly the function that a run used, within bounds (see `open_bounded`), for comparison with the run's scores.

    Args:
        name: name in the run's spec.
        pin: pin of the run.
        context: context of the deployment in which functions are registered.
        threads: CPU threads of this process for the inference engine; None: as many as this deployment's workers have.

    Raises:
        NotFound: this version was removed.
        Conflict: it has another digest, revision or numeric class here.
        TransientError: opening it needs more memory than it may have.
        ValerieError: it cannot be opened here.
    """
    return open_bounded(lambda: _open_pinned(name, pin, context, threads), context.settings, name=name)


def open_reference(reference: str, *, context: Context, threads: int | None = None) -> BoundedFunction:
    """Load a function to predict with, within the same bounds as in workers (see `open_bounded`).

    Args:
        reference: a function file, the name of an installed function, ``name`` or ``name@digest`` of a registered one.
        context: context of the deployment in which functions are registered.
        threads: CPU threads of this process for the inference engine; None: as many as this deployment's workers have, which
            gives the same numeric class.

    Raises:
        UnknownName, NotFound, InvalidInput, MissingDependency: see `plugins.create_function`, `open_function` and
            `valerie.pipeline.functions.registry.find`.
        TransientError: opening it needs more memory than it may have.
    """
    return open_bounded(lambda: _open(reference, context, threads), context.settings, name=display_name(reference))


def _open_pinned(name: str, pin: FunctionPin, context: Context, threads: int | None) -> PerceptionFunction:
    try:
        function = FunctionLoader(context).open(name, pin, threads=threads)
    except TransientError as error:
        raise _not_comparable(str(error)) from None
    if function.revision != pin.revision:
        function.close()
        raise _not_comparable(f"{name} is in revision {function.revision} here; the run pinned {pin.revision}")
    return function


def _not_comparable(reason: str) -> Conflict:
    return Conflict(
        f"{reason}. Only results of the same numeric class can be compared: use a machine like the run's workers with as many "
        "threads, or run the validation again here"
    )


def _open(reference: str, context: Context, threads: int | None) -> PerceptionFunction:
    settings = context.settings
    threads, device = threads or settings.inference_threads, settings.infer_device
    if is_file(reference):
        path = Path(reference)
        document = local_document(display_name(reference), path, device=device, precision=settings.infer_precision)
        return open_function(document, path, threads=threads, device=device)
    installed = plugins.function_names(testing=settings.testing_engines)
    if reference in installed:
        return open_installed(reference, settings, threads=threads)
    with reading(context.engine) as connection:
        names = registry.names(connection, registry.known(connection, [reference]))
        if reference.partition("@")[0] not in names:
            raise UnknownName("function", reference, {*installed, *names}, field="function")
        document = registry.find(connection, reference).document
    return FunctionLoader(context).open_document(document, threads=threads)
