"""Open the database: SQLite in WAL mode with BEGIN IMMEDIATE, or Postgres through psycopg 3."""

from __future__ import annotations

import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any, Final

from sqlalchemy import Connection, Engine, NullPool, create_engine, event, func, select
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from valerie.errors import InvalidInput, StorageFull, StorageUnavailable, TransientError

#: Longest wait of a writer: with eight writing processes, SQLite starves one for seconds.
_BUSY_TIMEOUT_MS = 30_000
#: Longest time of a statement on Postgres, unless a process sets another.
_STATEMENT_SECONDS: Final = 120.0
#: Digests are scattered over their tables: with the default of 2 MiB, feeding a large run rereads most pages.
_CACHE_KIB = 32 * 1024
#: Pages in the log before they are copied into the database (40 MB), since the same pages change from block to block.
_CHECKPOINT_PAGES = 10_000
_OPTIONS: Final = {
    "hide_parameters": True,  # keep thousands of rows out of the log
    # `valerie.db.column_types` reads and writes JSON text itself.
    "json_serializer": lambda text: text,
    "json_deserializer": lambda text: text,
}
#: Execution option of engines whose database has no clock of its own.
_CLOCK = "valerie_clock"
#: Held by `unforked`, and by every fork while it happens.
_FORK = threading.Lock()
os.register_at_fork(before=_FORK.acquire, after_in_parent=_FORK.release, after_in_child=_FORK.release)


def open_database(url: str, *, clock: Callable[[], float] = time.time, seconds: float = _STATEMENT_SECONDS) -> Engine:
    """Return an engine for ``sqlite:///path`` or ``postgresql://…``.

    On SQLite every writing transaction begins with BEGIN IMMEDIATE. A deferred transaction that reads and then writes fails
    with "database is locked" at once, regardless of the busy timeout, since its snapshot cannot be upgraded.

    Args:
        url: URL of the database.
        clock: returns Unix seconds; only SQLite uses it, Postgres has its own.
        seconds: longest time of a statement on Postgres; a wait for a lock ends earlier.

    Raises:
        InvalidInput: another kind of database.
    """
    address = make_url(url)
    backend = address.get_backend_name()
    if backend == "sqlite":
        arguments = {"timeout": _BUSY_TIMEOUT_MS / 1000}
        engine = create_engine(address, connect_args=arguments, execution_options={_CLOCK: clock}, **_OPTIONS)
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_immediate)
        return engine
    if backend == "postgresql":
        address = address.set(drivername="postgresql+psycopg")
        engine = create_engine(address, pool_pre_ping=True, pool_size=4, pool_timeout=seconds / 2, **_OPTIONS)
        event.listen(engine, "do_connect", _bounded(seconds))
        return engine
    raise InvalidInput("unknown kind of database", field="database_url", value=backend, limit="sqlite or postgresql")


def open_rows(connect: Callable[[], sqlite3.Connection]) -> Engine:
    """Return an engine for an SQLite file of rows that is never written after it was made, so that it needs no locks.

    Args:
        connect: opens the file; called for every transaction, since the file may be deleted between two.
    """
    engine = create_engine(
        "sqlite://", creator=connect, poolclass=NullPool, execution_options={_CLOCK: time.time}, **_OPTIONS
    )
    event.listen(engine, "begin", _begin_immediate)
    return engine


def _prepare_sqlite(connection: Any, _record: object) -> None:
    # The driver must not open transactions by itself: the "begin" event below does.
    connection.isolation_level = None
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.execute(f"PRAGMA busy_timeout={_BUSY_TIMEOUT_MS}")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.execute(f"PRAGMA cache_size=-{_CACHE_KIB}")
    cursor.execute(f"PRAGMA wal_autocheckpoint={_CHECKPOINT_PAGES}")
    cursor.close()


def _bounded(seconds: float) -> Callable[..., Any]:
    from valerie.db.postgres import BoundedConnection

    def connect(_dialect: object, _record: object, arguments: Any, options: dict[str, Any]) -> BoundedConnection:
        return BoundedConnection.opened(arguments, options, seconds=seconds)

    return connect


@contextmanager
def unbounded(connection: Connection) -> Iterator[None]:
    """Let the statements of a transaction take any time, as those of a migration of large tables may."""
    if connection.dialect.name != "postgresql":
        yield
        return
    raw: Any = connection.connection.driver_connection
    earlier = raw.unbound()
    try:
        yield
    finally:
        raw.silence = earlier


def _begin_immediate(connection: Connection) -> None:
    read_only = connection.get_execution_options().get("valerie_read_only", False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")


def database_time(connection: Connection) -> float:
    """Return the current time, Unix seconds, by the clock that all processes share.

    All times that processes compare (leases, heartbeats, messages) come from it: their own clocks may be hours apart.
    With Postgres it is the clock of the server's machine; the processes of one SQLite database share a machine anyway.
    """
    clock = connection.get_execution_options().get(_CLOCK)
    if clock is not None:
        return float(clock())
    return float(connection.scalar(select(func.extract("epoch", func.clock_timestamp()))) or 0.0)


def compared_clocks(connection: Connection) -> tuple[float, float]:
    """Return `database_time`, and by how many seconds this process's clock is at least ahead of it; negative if it is behind.

    While the database answers, both clocks go on, so that a slow answer hides a difference but never feigns one.
    """
    before = time.time()
    now = database_time(connection)
    return now, max(before - now, 0.0) + min(time.time() - now, 0.0)


def database_moment(connection: Connection) -> datetime:
    """Return `database_time` as a moment in UTC, for the times of rows."""
    return datetime.fromtimestamp(database_time(connection), UTC)


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that writes; it is committed at the end and rolled back on any error.

    Raises:
        StorageFull: no space left for the database.
        StorageUnavailable: the database cannot be written.
        TransientError: the database is locked or does not answer; try again.
    """
    with translated(), engine.begin() as connection:
        yield connection


@contextmanager
def unforked() -> Iterator[None]:
    """Delay forks meanwhile: threads of a process that forks wrap their transactions in it.

    SQLite also keeps the locks of its own process in memory. A child forked in the middle of a transaction inherits that
    memory and finds the database locked for its whole life, by a connection that nobody closes.
    """
    with _FORK:
        yield


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that sees one consistent state; it must not write, and on SQLite it takes no write lock."""
    with translated(), engine.connect() as connection:
        yield connection.execution_options(valerie_read_only=True)


@contextmanager
def translated() -> Iterator[None]:
    """Translate the driver's errors into VALERIE's."""
    try:
        yield
    except OperationalError as error:
        text = str(error.orig).lower()
        if "full" in text or "no space" in text:
            raise StorageFull(f"the database has no space left: {error.orig}") from error
        if "readonly" in text or "unable to open" in text:
            raise StorageUnavailable(f"the database cannot be written: {error.orig}") from error
        raise TransientError(f"the database did not answer: {error.orig}") from error
    except PoolTimeoutError as error:
        raise TransientError("the database did not answer: all connections of this process are in use") from error
    except DBAPIError as error:
        if error.connection_invalidated:
            raise TransientError(f"the connection to the database was lost: {error.orig}") from error
        raise
