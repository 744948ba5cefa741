"""Payloads of registered functions on this machine: fetched once by digest, in a folder of bounded size."""

from __future__ import annotations

import os
import time
from pathlib import Path

from valerie.errors import NotFound, StorageFull, StorageUnavailable
from valerie.perception.documents.function import FunctionDocument
from valerie.storage.keys import function_key
from valerie.storage.store import ArtifactStore

#: Bytes per read from the store, so that a large network is never in memory as a whole.
_PIECE_BYTES = 1 << 24


class PayloadCache:
    """Files by digest; several processes may share the folder.

    Args:
        store: source of payloads.
        folder: folder on this machine.
        max_bytes: size limit of the folder; beyond it, the least recently used files are deleted.
    """

    def __init__(self, store: ArtifactStore, folder: Path, *, max_bytes: int) -> None:
        self._store = store
        self._folder = folder
        self._max_bytes = max_bytes

    def fetch(self, document: FunctionDocument) -> Path | None:
        """Return the payload as a file, or None if the function has none; the caller verifies its digest.

        Raises:
            NotFound: the payload was removed.
            StorageFull, StorageUnavailable: this machine's folder cannot be written.
        """
        if document.payload is None:
            return None
        payload = document.payload
        path = self._folder / f"{payload.sha256}.{payload.format}"
        try:
            if not path.is_file() or path.stat().st_size != payload.bytes:
                self._write(path, function_key(payload.sha256, payload.format))
            os.utime(path)
            self._trim(keep=path)
        except OSError as error:
            kind = StorageFull if error.errno in (28, 122) else StorageUnavailable
            raise kind(f"the folder of functions {self._folder} cannot be written: {error.strerror}") from error
        return path

    def forget(self, document: FunctionDocument) -> None:
        """Remove a damaged file."""
        if document.payload is not None:
            (self._folder / f"{document.payload.sha256}.{document.payload.format}").unlink(missing_ok=True)

    def _write(self, path: Path, key: str) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        size = self._store.head(key).size
        partial = path.with_name(f".{path.name}.{os.getpid()}-{time.time_ns()}")
        try:
            with partial.open("wb") as stream:
                for start in range(0, size, _PIECE_BYTES):
                    stream.write(self._store.get_range(key, start, _PIECE_BYTES))
            partial.replace(path)
        except NotFound:
            partial.unlink(missing_ok=True)
            raise
        except OSError:
            partial.unlink(missing_ok=True)
            raise

    def _trim(self, *, keep: Path) -> None:
        files = []
        for path in self._folder.iterdir():
            try:
                files.append((path.stat().st_mtime, path.stat().st_size, path))
            except FileNotFoundError:
                continue  # another process deleted it
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self._max_bytes:
                return
            if path != keep:
                # A process that has opened the file keeps its contents.
                path.unlink(missing_ok=True)
                total -= size
