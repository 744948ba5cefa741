"""Migrate a database to this version's tables; entry points do so before anything else touches the database."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Final

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, text

from valerie.db.engine import reading, translated
from valerie.errors import Conflict

#: An arbitrary number: if several processes start at once on Postgres, its holder migrates and the others wait.
_ADVISORY_LOCK: Final = 728_416_095
#: Revisions of databases from before 0.1.0, the first release.
_UNRELEASED: Final = frozenset({"0001", "0002", "0003", "0004", "0005", "0006"})


def migrate(engine: Engine) -> None:
    """Upgrade to the newest revision.

    Raises:
        Conflict: the database is from a newer version of VALERIE, or from before its first release; it is left unchanged.
        StorageUnavailable, TransientError: the database cannot be written or does not answer.
    """
    config = _config()
    _refuse_unknown(engine, config)
    with translated(), engine.begin() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _ADVISORY_LOCK})
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def require_current(engine: Engine) -> None:
    """Refuse a database without this version's tables; workers do not migrate.

    Raises:
        Conflict: the database is older or newer than this version; the message says what to do.
    """
    config = _config()
    _refuse_unknown(engine, config)
    head = ScriptDirectory.from_config(config).get_current_head()
    current = _current(engine)
    if current != head:
        raise Conflict(f"the database is at revision {current}, this version needs {head}: run `valerie migrate`")


def _refuse_unknown(engine: Engine, config: Config) -> None:
    current = _current(engine)
    if current in _UNRELEASED:
        raise Conflict(
            f"the database is from before VALERIE 0.1.0 (revision {current}), which no released version reads; nothing in it "
            "was changed. Move it away or name another one (VALERIE_DATABASE_URL), and submit its specs again"
        )
    known = {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}
    if current is not None and current not in known:
        raise Conflict(
            f"the database is at revision {current}, which this version of VALERIE does not know: it was written by a "
            "newer one; install that version, or use another database"
        )


def _current(engine: Engine) -> str | None:
    with reading(engine) as connection:
        return MigrationContext.configure(connection).get_current_revision()


def _config() -> Config:
    spec = importlib.util.find_spec("migrations")
    if spec is None or spec.origin is None:
        raise Conflict("the package `migrations` is not installed beside `valerie`")
    config = Config()
    config.set_main_option("script_location", str(Path(spec.origin).parent))
    return config
