"""Payloads of registered functions on this machine: fetched once by digest, in a folder of bounded size."""

from __future__ import annotations

from pathlib import Path

from valerie.perception.documents.function import FunctionDocument, Payload
from valerie.storage.bounded_folder import BoundedFolder
from valerie.storage.keys import function_key
from valerie.storage.store import ArtifactStore

#: Bytes per read from the store, so that a large network is never in memory as a whole.
_PIECE_BYTES = 1 << 24


class PayloadCache:
    """Files by digest; several processes may share the folder.

    Args:
        store: source of payloads.
        folder: where they are kept.
    """

    def __init__(self, store: ArtifactStore, folder: BoundedFolder) -> None:
        self._store = store
        self._folder = folder

    def fetch(self, document: FunctionDocument) -> Path | None:
        """Return the payload as a file, or None if the function has none; the caller verifies its digest.

        Raises:
            NotFound: the payload was removed.
            StorageFull, StorageUnavailable: this machine's folder cannot be written.
        """
        payload = document.payload
        if payload is None:
            return None
        key = function_key(payload.sha256, payload.format)
        return self._folder.fetch(_name(payload), lambda path: self._write(path, key), size=payload.bytes)

    def forget(self, document: FunctionDocument) -> None:
        """Remove a damaged file."""
        if document.payload is not None:
            self._folder.path(_name(document.payload)).unlink(missing_ok=True)

    def _write(self, path: Path, key: str) -> None:
        size = self._store.head(key).size
        with path.open("wb") as stream:
            for start in range(0, size, _PIECE_BYTES):
                stream.write(self._store.get_range(key, start, _PIECE_BYTES))


def _name(payload: Payload) -> str:
    return f"{payload.sha256}.{payload.format}"
