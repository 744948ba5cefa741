"""Migrate a database to this version's tables; entry points do so before anything else touches the database."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sqlalchemy import Engine, inspect, text

from valerie.db.engine import reading, translated
from valerie.db.models import REVISION
from valerie.errors import Conflict

if TYPE_CHECKING:
    from alembic.config import Config

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
    current = _current(engine)
    if current == REVISION:
        return
    _refuse_unknown(current)
    from alembic import command

    config = _config()
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
    current = _current(engine)
    if current != REVISION:
        _refuse_unknown(current)
        raise Conflict(f"the database is at revision {current}, this version needs {REVISION}: run `valerie migrate`")


def _refuse_unknown(current: str | None) -> None:
    from alembic.script import ScriptDirectory

    if current in _UNRELEASED:
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


def _current(engine: Engine) -> str | None:
    """Return the revision of a database; None without tables. Alembic takes longer to import than this."""
    with reading(engine) as connection:
        if not inspect(connection).has_table("alembic_version"):
            return None
        return connection.execute(text("SELECT version_num FROM alembic_version")).scalar()


def _config() -> Config:
    from alembic.config import Config

    spec = importlib.util.find_spec("migrations")
    if spec is None or spec.origin is None:
        raise Conflict("the package `migrations` is not installed beside `valerie`")
    config = Config()
    config.set_main_option("script_location", str(Path(spec.origin).parent))
    return config
