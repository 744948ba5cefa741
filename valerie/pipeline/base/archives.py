"""The archives of a deployment: SQLite files on this machine, filled from the artifact store when a run is read."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Mapping
from hashlib import sha256
from pathlib import Path
from threading import Lock
from typing import Final
from urllib.parse import quote

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray
from sqlalchemy import Engine

from valerie.db import copying
from valerie.db.engine import open_rows, reading
from valerie.db.long_table import measure_columns
from valerie.db.models import REVISION
from valerie.errors import StorageUnavailable
from valerie.runs.products.archive import Archive
from valerie.storage.bounded_folder import BoundedFolder
from valerie.storage.store import ArtifactStore

#: Engines that a process keeps, with their compiled statements; each has no connection between two uses.
_ENGINES: Final = 32
#: Another process may delete a file between its writing and its opening, if the folder's bound is too small for both.
_ATTEMPTS: Final = 5
#: Names the tables of this version, since the files of an older one have its own.
_TABLES: Final = f"{REVISION} {', '.join(map(str, measure_columns()))}"


class StoredArchives:
    """See `valerie.db.archives.Archives`; several threads and processes may use one folder.

    Args:
        engine: the deployment's database.
        store: has the files of the archives.
        folder: for SQLite files.
    """

    def __init__(self, engine: Engine, store: ArtifactStore, folder: BoundedFolder) -> None:
        self._engine = engine
        self._store = store
        self._folder = folder
        self._lock = Lock()
        #: Held by the thread that writes a file.
        self._writing = Lock()
        self._engines: LRUCache[str, Engine] = LRUCache(_ENGINES)
        self._objects: dict[str, NDArray[np.bytes_]] = {}

    def rows(self, run_id: str, parent_run: str | None, archive: Archive) -> Engine:
        """See `valerie.db.archives.Archives`."""
        # The parent is the only thing in a run's own row that still changes: it may be deleted.
        content = f"{archive.model_dump_json()} {parent_run} {_TABLES}"
        name = f"{run_id}-{sha256(content.encode()).hexdigest()[:16]}.sqlite3"
        with self._lock:
            if name not in self._engines:
                self._engines[name] = open_rows(lambda: self._connect(name, run_id, archive))
            return self._engines[name]

    def stored(self, archives: Mapping[str, Archive], digests: Collection[str]) -> set[str]:
        """See `valerie.db.archives.Archives`."""
        asked = np.array(list(digests), np.bytes_)
        found = np.zeros(len(asked), np.bool_)
        for run_id, archive in archives.items():
            objects = self._stored_objects(run_id, archive)
            if len(objects) and len(asked):
                places = np.searchsorted(objects, asked).clip(max=len(objects) - 1)
                found |= objects[places] == asked
        return {digest.decode() for digest in asked[found].tolist()}

    def _stored_objects(self, run_id: str, archive: Archive) -> NDArray[np.bytes_]:
        from valerie.pipeline.base import row_files  # workers start without Parquet

        key = archive.tables[row_files.OBJECTS].sha256
        if key not in self._objects:
            self._objects[key] = np.array(row_files.read_objects(self._store, run_id, archive), np.bytes_)
        return self._objects[key]

    def _connect(self, name: str, run_id: str, archive: Archive) -> sqlite3.Connection:
        """Open a file to be read, and write it before if it is not there."""

        def write(path: Path) -> None:
            self._write(path, run_id, archive)

        for _ in range(_ATTEMPTS):
            if self._folder.path(name).exists():
                path = self._folder.fetch(name, write)
            else:
                with self._writing:
                    path = self._folder.fetch(name, write)
            try:
                address = f"file:{quote(str(path))}?mode=ro&immutable=1"
                connection = sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)
                connection.execute("SELECT 1 FROM runs").fetchone()
            except sqlite3.OperationalError:
                continue
            return connection
        raise StorageUnavailable(
            f"{self._folder.path(name)} is deleted again and again: raise VALERIE_ARCHIVE_CACHE_MB"
        )

    def _write(self, path: Path, run_id: str, archive: Archive) -> None:
        from valerie.pipeline.base import row_files

        row_files.read_files(path, self._store, run_id, archive.revision, archive.tables)
        target = row_files.open_new(path)
        with reading(self._engine) as connection, target.begin() as rows:
            copying.copy_head(connection, rows, run_id)
