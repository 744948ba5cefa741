"""Load functions that a run pinned: installed ones by name, registered ones by digest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from valerie.db.engine import reading
from valerie.errors import CorruptArtifact, TransientError
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import FunctionDocument, Payload
from valerie.perception.running.opening import require_payload
from valerie.pipeline.base.context import Context
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.opening import open_function_document, open_installed
from valerie.runs.products.pins import FunctionPin
from valerie.storage.bounded_folder import BoundedFolder
from valerie.storage.keys import function_key

#: Bytes per read from the store, so that a large network is never in memory as a whole.
_PIECE_BYTES: Final = 1 << 24
T = TypeVar("T")


class FunctionLoader:
    """Loader of one deployment's functions, including those that were registered after this process started.

    Files of registered functions are kept in a folder of bounded size, which processes of this machine share.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        settings = context.settings
        self._folder = BoundedFolder(settings.data_dir / "functions", max_bytes=settings.function_cache_mb * 2**20)

    def open(self, name: str, pin: FunctionPin, *, threads: int | None = None) -> PerceptionFunction:
        """Load a function as a run pinned it.

        Args:
            name: name in the run's spec.
            pin: pin of the run.
            threads: CPU threads of the inference engine; None: as many as this deployment's workers have.

        Raises:
            NotFound: this version was removed from the registry.
            TransientError: the function here differs from the pinned one; another worker may have the pinned one.
            ValerieError: it cannot be opened here.
        """
        settings = self._context.settings
        threads = threads or settings.inference_threads
        if pin.kind is not None:  # registered
            with reading(self._context.engine) as connection:
                document = registry.of_digest(connection, pin.digest, name).document
            function = self.open_document(document, threads=threads)
        else:
            function = open_installed(name, settings, threads=threads)
        if function.card.digest != pin.digest:
            has, wants = function.card.digest[:12], pin.digest[:12]
            function.close()
            raise TransientError(f"{name} has digest {has} here; the run pinned {wants}")
        if function.numeric_class != pin.numeric_class:
            runs_as = function.numeric_class
            function.close()
            raise TransientError(f"{name} runs as {runs_as} here; the run pinned {pin.numeric_class}")
        return function

    def file(self, document: FunctionDocument) -> Path:
        """Return the verified payload of a registered function that has one; use the file soon, since a cache owns it.

        Raises:
            NotFound: the payload was removed.
            CorruptArtifact: the store has other bytes.
            StorageFull, StorageUnavailable: this machine's folder cannot be written.
        """

        def verified(path: Path | None) -> Path:
            require_payload(document, path)
            assert path is not None, "require_payload refuses it"
            return path

        return self._of_payload(document, verified)

    def open_document(self, document: FunctionDocument, *, threads: int) -> PerceptionFunction:
        """Load a registered function.

        Raises:
            ValerieError: it cannot be opened here; see `valerie.perception.running.opening.open_function`.
        """
        settings = self._context.settings
        return self._of_payload(
            document, lambda path: open_function_document(document, path, settings, threads=threads)
        )

    def _of_payload(self, document: FunctionDocument, use: Callable[[Path | None], T]) -> T:
        """Return what ``use`` makes of a function's file, None without one; a damaged file is fetched again, once."""
        try:
            return use(self._fetched(document.payload))
        except CorruptArtifact:  # of this machine's copy, or of the store's
            if document.payload is not None:
                self._folder.path(_file_name(document.payload)).unlink(missing_ok=True)
            return use(self._fetched(document.payload))

    def _fetched(self, payload: Payload | None) -> Path | None:
        if payload is None:
            return None
        store, key = self._context.store, function_key(payload.sha256, payload.format)

        def write(path: Path) -> None:
            size = store.head(key).size
            with path.open("wb") as stream:
                for start in range(0, size, _PIECE_BYTES):
                    stream.write(store.get_range(key, start, _PIECE_BYTES))

        return self._folder.fetch(_file_name(payload), write, size=payload.bytes)


def _file_name(payload: Payload) -> str:
    return f"{payload.sha256}.{payload.format}"
