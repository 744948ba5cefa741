"""A folder of bounded size on this machine, with files that can be written again; several processes may share it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from valerie.errors import StorageFull, StorageUnavailable

#: A file that is still being written begins with a dot; after so many seconds its writer is dead.
_DEAD_SECONDS: Final = 3_600


class BoundedFolder:
    """Files by name; beyond the bound, the least recently used ones are deleted.

    Args:
        folder: folder on this machine.
        max_bytes: its bound. The file that is fetched stays, however large.
    """

    def __init__(self, folder: Path, *, max_bytes: int) -> None:
        self._folder = folder
        self._max_bytes = max_bytes

    def path(self, name: str) -> Path:
        """Return the path of a file, which may not exist."""
        return self._folder / name

    def fetch(self, name: str, write: Callable[[Path], None], *, size: int | None = None) -> Path:
        """Return a file that is complete; write it first if it is missing. Another process may delete it at any time.

        Args:
            name: of the file.
            write: writes it under another name, so that nobody sees half of it.
            size: in bytes; a file of another size is written again.

        Raises:
            StorageFull, StorageUnavailable: the folder cannot be written.
        """
        path = self.path(name)
        try:
            present = _size(path)
            if present is None or size not in (None, present):
                self._write(path, write)
            with suppress(FileNotFoundError):
                os.utime(path)
            self._trim(keep=path)
        except OSError as error:
            kind = StorageFull if error.errno in (28, 122) else StorageUnavailable
            raise kind(f"the folder {self._folder} cannot be written: {error.strerror}") from error
        return path

    def _write(self, path: Path, write: Callable[[Path], None]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{os.getpid()}-{time.time_ns()}")
        try:
            write(partial)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)

    def _trim(self, *, keep: Path) -> None:
        files = []
        for path in self._folder.iterdir():
            try:
                modified, size = path.stat().st_mtime, path.stat().st_size
            except FileNotFoundError:
                continue  # another process deleted it
            if not path.name.startswith(".") or modified < time.time() - _DEAD_SECONDS:
                files.append((modified, size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self._max_bytes:
                return
            if path != keep:
                # A process that has opened the file keeps its contents.
                path.unlink(missing_ok=True)
                total -= size


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return None
