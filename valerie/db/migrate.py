"""Migrate a database to this version's tables; entry points do so before anything else touches the database.

Alembic's revisions describe the tables. The columns of measures follow `valerie.measures.MEASURES`: a database gets those that
its tables lack, empty in the rows that it has.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import Column, Connection, Engine, inspect, select, text

from valerie.db.engine import open_database, reading, translated, unbounded
from valerie.db.long_table import measure_columns
from valerie.db.models import REVISION
from valerie.errors import Conflict

if TYPE_CHECKING:
    from alembic.config import Config

#: An arbitrary number: if several processes start at once on Postgres, its holder migrates and the others wait.
_ADVISORY_LOCK: Final = 728_416_095
#: How the revisions of databases from before 0.1.0, the first release, begin.
_UNRELEASED: Final = "000"


class _State(NamedTuple):
    """The tables that a database has.

    Attributes:
        revision: Alembic's revision; None without tables.
        complete: True if they have the columns of all measures.
    """

    revision: str | None
    complete: bool


def migrate(engine: Engine) -> None:
    """Upgrade to the newest revision, with the columns of all measures.

    Raises:
        Conflict: the database is from a newer version of VALERIE, or from before its first release; it is left unchanged.
        StorageUnavailable, TransientError: the database cannot be written or does not answer.
    """
    state = _state(engine)
    if state == (REVISION, True):
        return
    _refuse_unknown(state.revision)
    _upgrade(engine, "head")


def migrate_url(url: str) -> None:
    """Migrate the database at an address; errors as in `migrate`."""
    engine = open_database(url)
    try:
        migrate(engine)
    finally:
        engine.dispose()


def create(engine: Engine, revision: str) -> None:
    """Make the empty tables of a revision, with the columns of all measures of this version.

    Raises:
        Conflict: the revision is of a newer version of VALERIE, or from before its first release.
    """
    _refuse_unknown(revision)
    _upgrade(engine, revision)


def require_current(engine: Engine) -> None:
    """Refuse a database without this version's tables; workers do not migrate.

    Raises:
        Conflict: the database is older or newer than this version; the message says what to do.
    """
    state = _state(engine)
    if state.revision != REVISION:
        _refuse_unknown(state.revision)
        raise Conflict(
            f"the database is at revision {state.revision}, this version needs {REVISION}: run `valerie migrate`"
        )
    if not state.complete:
        raise Conflict("the database lacks columns of measures of this version: run `valerie migrate`")


def _upgrade(engine: Engine, revision: str) -> None:
    from alembic import command

    config = _config()
    with translated(), engine.begin() as connection, unbounded(connection):
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
        config.attributes["connection"] = connection
        command.upgrade(config, revision)
        _add_measures(connection)


def _refuse_unknown(current: str | None) -> None:
    from alembic.script import ScriptDirectory

    if current is not None and current.startswith(_UNRELEASED):
        raise Conflict(
            f"the database is from before VALERIE 0.1.0 (revision {current}), which no released version reads; nothing in it "
            "was changed. Move it away or name another one (VALERIE_DATABASE_URL), and submit its specs again"
        )
    revisions = {script.revision for script in ScriptDirectory.from_config(_config()).walk_revisions()}
    if current is not None and current not in revisions:
        raise Conflict(
            f"the database is at revision {current}, which this version of VALERIE does not know: it was written by a "
            "newer one; install that version, or use another database"
        )


def _state(engine: Engine) -> _State:
    """Return the tables that a database has. Alembic takes longer to import than this."""
    with reading(engine) as connection:
        if not inspect(connection).has_table("alembic_version"):
            return _State(None, complete=False)
        revision = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
        return _State(revision, complete=revision == REVISION and not _missing_measures(connection))


def _add_measures(connection: Connection) -> None:
    from alembic.migration import MigrationContext
    from alembic.operations import Operations

    operations = Operations(MigrationContext.configure(connection))
    for column in _missing_measures(connection):
        operations.add_column(column.table.name, Column(column.name, column.type))


def _missing_measures(connection: Connection) -> list[Column[Any]]:
    """Return the columns of measures that the tables of a database lack."""
    columns = measure_columns()
    tables = {column.table for column in columns}
    present = {table: set(connection.execute(select(text("*")).select_from(table).limit(0)).keys()) for table in tables}
    return [column for column in columns if column.name not in present[column.table]]


def _config() -> Config:
    from alembic.config import Config

    spec = importlib.util.find_spec("migrations")
    if spec is None or spec.origin is None:
        raise Conflict("the package `migrations` is not installed beside `valerie`")
    config = Config()
    config.set_main_option("script_location", str(Path(spec.origin).parent))
    return config
