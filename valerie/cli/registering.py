"""The function registry of a server, or of the data folder while no server runs on it, and the registration of files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final, Protocol

from valerie.cli.shell import recorded, say
from valerie.errors import InvalidInput, NotFound
from valerie.local.terminal import command_name

if TYPE_CHECKING:
    from valerie.answers import Function, RegisteredFunction
    from valerie.client import Client
    from valerie.pipeline.base.context import Context
    from valerie.pipeline.functions.catalog import FunctionEntry
    from valerie.pipeline.functions.guarded_import import ImportedFunction
    from valerie.settings import Settings

#: Suffixes of a document with a file's name, in the same folder.
_SIDECARS: Final = (".yaml", ".yml", ".json")

#: Opens a registry when called.
Opening = Callable[[], AbstractContextManager["Registry"]]


class Registry(Protocol):
    """A registry, here or on a server."""

    def functions(self) -> list[Function]: ...
    def function(self, reference: str) -> Function: ...
    def function_payload(self, reference: str) -> bytes: ...
    def remove_function(self, reference: str) -> None: ...
    def register_function(self, texts: dict[str, str], payload: Path | None, folder: Path) -> RegisteredFunction: ...


class Remote:
    """The registry of a server."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self.functions, self.function = client.functions, client.function
        self.function_payload, self.remove_function = client.function_payload, client.remove_function

    def register_function(
        self,
        texts: dict[str, str],
        payload: Path | None,
        folder: Path,  # noqa: ARG002  the server converts in a folder of its own
    ) -> RegisteredFunction:
        return self._client.register_function(texts, payload)


class _Local:
    """The registry of this data folder, while no server runs on it."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def functions(self) -> list[Function]:
        from valerie.pipeline.functions.catalog import functions

        return [_as_server_shows(entry) for entry in functions(self._context)]

    def function(self, reference: str) -> Function:
        from valerie.pipeline.functions.catalog import function

        return _as_server_shows(function(self._context, reference))

    def function_payload(self, reference: str) -> bytes:
        from valerie.db.engine import reading
        from valerie.pipeline.functions.registry import find, read_payload

        with reading(self._context.engine) as connection:
            document = find(connection, reference).document
        return read_payload(self._context, document)

    def remove_function(self, reference: str) -> None:
        from valerie.pipeline.functions.registry import remove

        with recorded(self._context, f"function remove {reference}"):
            remove(self._context, reference)

    def register_function(self, texts: dict[str, str], payload: Path | None, folder: Path) -> RegisteredFunction:
        from valerie.answers import RegisteredFunction
        from valerie.pipeline.functions.catalog import registered_function
        from valerie.pipeline.functions.guarded_import import ImportRequest, import_function
        from valerie.pipeline.functions.registry import register

        name = "" if payload is None else payload.name
        imported = import_function(ImportRequest(payload, name, **texts), folder, self._context.settings)
        with recorded(self._context, f"function import {imported.document.name}"):
            registered, new = register(self._context, imported.document, imported.payload)
        function = _as_server_shows(registered_function(self._context, registered, imported.trial))
        return RegisteredFunction(function, new)


def _as_server_shows(entry: FunctionEntry) -> Function:
    """Return an entry of the catalog in the form of a server's answer."""
    from pydantic import TypeAdapter

    from valerie.answers import Function
    from valerie.pipeline.functions.catalog import FunctionEntry

    members = TypeAdapter(FunctionEntry).dump_python(entry, mode="json", exclude={"trial"})
    return Function.model_validate({**members, "check": entry.check})


@contextmanager
def open_registry(settings: Settings, url: str | None = None, *, create: bool = False) -> Iterator[Registry]:
    """Open the registry of the named server, else of the server on the data folder, else of the data folder itself.

    Args:
        settings: of this process.
        url: of a server.
        create: create the data folder's registry if it is missing; if False, use a temporary empty one instead.
    """
    from valerie.cli.connecting import client_of
    from valerie.embedded import running

    if url is not None or running.find(settings.data_dir) is not None:
        with client_of(settings, url) as client:
            yield Remote(client)
        return
    from valerie.local.deployment import create_or_migrate, deployment_or_empty

    if create:
        create_or_migrate(settings)
    with deployment_or_empty(settings) as context:
        yield _Local(context)


def register_file(
    opening: Opening, file: Path | None, *, document: Path | None = None, **texts: str
) -> RegisteredFunction:
    """Read a function's files and let the registry convert, check and register it.

    Args:
        opening: opens the registry; called after all files were read.
        file: checkpoint, ONNX file or Hugging Face folder; None for kinds without one.
        document: facts that the file does not state; None: the file of the same name with a suffix in `_SIDECARS`.
        texts: name, engine and precision, which override the document.

    Returns:
        The catalog's entry with the trial, and whether this version is new.

    Raises:
        NotFound: there is no such file.
        ValerieError: the file or the document is refused.
    """
    texts, payload = _files_of(file, document, texts)
    with TemporaryDirectory(prefix="valerie-import-") as folder, opening() as registry:
        return registry.register_function(texts, payload, Path(folder))


def import_file(file: Path, folder: Path, settings: Settings, *, document: Path | None = None) -> ImportedFunction:
    """Convert and check a function's files here, as `register_file` does, and register nothing.

    Args:
        file, document: see `register_file`.
        folder: for the converted file.
        settings: of this process.
    """
    from valerie.pipeline.functions.guarded_import import ImportRequest, import_function

    texts, payload = _files_of(file, document, {})
    assert payload is not None, "a file has a payload"
    return import_function(ImportRequest(path=payload, filename=payload.name, **texts), folder, settings)


def functions_named(value: str, opening: Opening) -> list[str]:
    """Resolve the value of ``--functions``: names of functions and files, separated by commas.

    A file is registered, unless it is already, and stands for exactly that version. An item with the suffix of a function's file
    is a file if that exists; an item with a slash is always a file and must exist.

    Returns:
        References for a spec.

    Raises:
        NotFound: no such file.
        ValerieError: a file is refused.
    """
    from valerie.pipeline.functions.guarded_import import SUFFIXES

    references = []
    for item in filter(None, (part.strip() for part in value.split(","))):
        path = Path(item)
        if "/" not in item and not (path.suffix.lower() in SUFFIXES and path.is_file()):
            say_missing_files([item])
            references.append(item)
            continue
        registered, new = register_file(opening, path)
        state = "registered" if new else "registered already"
        say(f"{item} is {state} as {registered.reference}; `{command_name()} function show` prints its card")
        assert registered.reference is not None, "a registered version has a reference"
        references.append(registered.reference)
    return references


def say_missing_files(names: Iterable[str]) -> None:
    """Say which names of functions look like files that do not exist, or are files of another kind."""
    from valerie.pipeline.functions.guarded_import import SUFFIXES

    for name in names:
        path, is_function = Path(name), Path(name).suffix.lower() in SUFFIXES
        if is_function and not path.is_file():
            say(f"{name}: no such file; taken as the name of a function")
        elif path.suffix and path.is_file() and not is_function:
            say(f"{name}: not a file of a function ({', '.join(sorted(SUFFIXES))}); taken as the name of one")


def _files_of(file: Path | None, document: Path | None, texts: dict[str, str]) -> tuple[dict[str, str], Path | None]:
    """Return the texts with the document's, and the file with the weights; see `register_file`."""
    if file is not None and not (file.is_file() or file.is_dir()):
        raise NotFound("file", file)
    if document is None and file is not None:
        stem = file.name if file.is_dir() else file.stem
        beside = (file.absolute().with_name(stem + suffix) for suffix in _SIDECARS)
        document = next((path for path in beside if path.is_file()), None)
        if document is not None:
            say(f"using the document {document}")
    if document is not None:
        texts = {"document": _text(document), **texts}
    payload = file
    if file is not None and file.is_dir():
        texts, payload = _huggingface(file, texts)
    return texts, payload


def _huggingface(folder: Path, texts: dict[str, str]) -> tuple[dict[str, str], Path]:
    """Return document and weights file of a folder: the configuration is read here, the weights by the registry."""
    from valerie.loading import load_document
    from valerie.perception.importing.huggingface import read_huggingface

    changes = load_document(texts["document"]) if "document" in texts else {}
    changes |= {field: value for field, value in texts.items() if field != "document"}
    name = str(changes.pop("name", folder.absolute().name.lower()))
    document, payload = read_huggingface(folder, name, **changes)
    return {"document": json.dumps(document.model_dump(mode="json", exclude={"payload"}))}, payload


def _text(path: Path) -> str:
    from valerie.loading import MAX_BYTES

    try:
        if path.stat().st_size > MAX_BYTES:
            raise InvalidInput("the document is too large", value=str(path), limit=f"{MAX_BYTES} bytes")
        return path.read_text("utf-8")
    except OSError as error:
        raise InvalidInput(f"the document cannot be read ({error.strerror})", value=str(path)) from error
    except UnicodeDecodeError:
        raise InvalidInput("the document is not UTF-8 text", value=str(path)) from None
