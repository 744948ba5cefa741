"""The rows of a run as Parquet files, one per table, and as the SQLite database that such files fill."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import closing
from hashlib import sha256
from pathlib import Path
from sqlite3 import Connection, connect
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq
from sqlalchemy import Boolean, Engine, Float, Integer, LargeBinary, Table
from sqlalchemy.types import TypeEngine

from valerie.db import migrate
from valerie.db.copying import TABLES
from valerie.db.engine import open_rows
from valerie.db.models import REVISION, Base, Product
from valerie.errors import CorruptArtifact
from valerie.runs.products.archive import Archive, ArchivedTable
from valerie.runs.products.states import ProductState
from valerie.storage.keys import archive_key
from valerie.storage.store import ArtifactStore

#: The list of the products whose objects an archive needs.
OBJECTS: Final = "objects"
#: Rows that are in memory at once.
_ROWS: Final = 20_000
_TYPES: Final = ((Boolean, pa.bool_()), (Integer, pa.int64()), (Float, pa.float64()), (LargeBinary, pa.binary()))
_TABLES: Final = tuple(table.__table__ for table in TABLES if isinstance(table.__table__, Table))


def open_new(path: Path) -> Engine:
    """Open a new SQLite file, which nobody else opens before it is complete."""
    return open_rows(lambda: _connected(path))


def _connected(path: Path) -> Connection:
    connection = connect(path, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA journal_mode=OFF")
    connection.execute("PRAGMA synchronous=OFF")
    return connection


def write_files(path: Path, store: ArtifactStore, run_id: str) -> Mapping[str, ArchivedTable]:
    """Write the tables of an SQLite file, and the list of their stored products, into the store."""
    written: dict[str, ArchivedTable] = {}
    done = f"SELECT digest FROM {Product.__tablename__} WHERE state = '{ProductState.DONE}' ORDER BY digest"  # noqa: S608
    with closing(connect(path)) as source:
        queries = {table.name: (_query(table), _schema(table)) for table in _TABLES}
        for name, (query, schema) in {**queries, OBJECTS: (done, pa.schema([("digest", pa.string())]))}.items():
            buffer, rows = io.BytesIO(), 0
            with pq.ParquetWriter(buffer, schema, compression="zstd") as writer:
                for batch in _batches(source, query, schema):
                    writer.write_batch(batch)
                    rows += batch.num_rows
            data = buffer.getvalue()
            written[name] = ArchivedTable(rows=rows, bytes=len(data), sha256=sha256(data).hexdigest())
            store.put(archive_key(run_id, name, written[name].sha256), data, replace=True)
    return written


def read_files(
    path: Path, store: ArtifactStore, run_id: str, revision: str, tables: Mapping[str, ArchivedTable]
) -> None:
    """Fill a new SQLite file from the store; the tables are then those of this version.

    Args:
        path: of the file.
        store: has the Parquet files.
        run_id: id of the run.
        revision: of the tables when they were written.
        tables: their files.

    Raises:
        NotFound: a file is gone.
        CorruptArtifact: a file is not the one that was written.
        Conflict: a newer version of VALERIE wrote them.
    """
    engine = open_new(path)
    try:
        if revision == REVISION:
            Base.metadata.create_all(engine)
        else:
            migrate.create(engine, revision)
        with closing(_connected(path)) as target:
            target.execute("BEGIN")
            for name, table in tables.items():
                if name != OBJECTS:
                    _insert(target, name, _opened(store, run_id, name, table))
            target.execute("COMMIT")
        if revision != REVISION:
            migrate.migrate(engine)
    finally:
        engine.dispose()


def read_objects(store: ArtifactStore, run_id: str, archive: Archive) -> list[str]:
    """Return the digests of the products whose objects an archive needs, sorted; errors as for `read_files`."""
    digests: list[str] = _opened(store, run_id, OBJECTS, archive.tables[OBJECTS]).read()["digest"].to_pylist()
    return digests


def differing_table(path: Path, other: Path) -> str | None:
    """Return the name of a table of a run that differs between two SQLite files, if any."""
    with closing(connect(path)) as connection:
        connection.execute("ATTACH DATABASE ? AS other", (str(other),))
        for table in _TABLES:
            names = (f'main."{table.name}"', f'other."{table.name}"')
            counts = {connection.execute(f"SELECT count(*) FROM {name}").fetchone() for name in names}  # noqa: S608
            less = f"SELECT * FROM {names[0]} EXCEPT SELECT * FROM {names[1]} LIMIT 1"  # noqa: S608  our own names
            if len(counts) > 1 or connection.execute(less).fetchone():
                return table.name
    return None


def _opened(store: ArtifactStore, run_id: str, name: str, table: ArchivedTable) -> pq.ParquetFile:
    key = archive_key(run_id, name, table.sha256)
    data = store.get(key)
    if sha256(data).hexdigest() != table.sha256:
        raise CorruptArtifact(f"{key} is not the file that was written when run {run_id} was archived")
    return pq.ParquetFile(pa.BufferReader(data))


def _insert(target: Connection, name: str, file: pq.ParquetFile) -> None:
    columns = file.schema_arrow.names
    known = {row[1] for row in target.execute(f'PRAGMA table_info("{name}")')}
    allowed = {kind for _, kind in _TYPES} | {pa.string()}
    if not known.issuperset(columns) or not allowed.issuperset(file.schema_arrow.types):
        raise CorruptArtifact(f"an archived table {name} has columns that the database's table does not have")
    names, marks = ", ".join(f'"{column}"' for column in columns), ", ".join("?" * len(columns))
    for batch in file.iter_batches(_ROWS):
        rows = zip(*(column.to_pylist() for column in batch.columns), strict=True)
        target.executemany(f'INSERT INTO "{name}" ({names}) VALUES ({marks})', rows)  # noqa: S608  checked names


def _query(table: Table) -> str:
    names = ", ".join(f'"{column.name}"' for column in table.columns)
    order = ", ".join(f'"{column.name}"' for column in table.primary_key)
    return f'SELECT {names} FROM "{table.name}" ORDER BY {order}'  # noqa: S608  our own names


def _schema(table: Table) -> pa.Schema:
    return pa.schema([(column.name, _type(column.type)) for column in table.columns])


def _type(kind: TypeEngine[object]) -> pa.DataType:
    """Return the Parquet type of a column as SQLite stores it: documents, words and digests are text."""
    return next((stored for types, stored in _TYPES if isinstance(kind, types)), pa.string())


def _batches(source: Connection, query: str, schema: pa.Schema) -> Iterator[pa.RecordBatch]:
    cursor = source.execute(query)
    while rows := cursor.fetchmany(_ROWS):
        columns = zip(*rows, strict=True)
        arrays = [_array(column, field.type) for column, field in zip(columns, schema, strict=True)]
        yield pa.RecordBatch.from_arrays(arrays, schema=schema)


def _array(column: tuple[object, ...], kind: pa.DataType) -> pa.Array:
    if pa.types.is_boolean(kind):
        column = tuple(None if value is None else bool(value) for value in column)
    return pa.array(column, kind)
