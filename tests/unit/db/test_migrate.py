"""Databases of this version, of a newer one, and of the time before the first release."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import Engine, text

import migrations
from valerie.db.engine import open_database
from valerie.db.migrate import migrate, require_current
from valerie.db.models import REVISION, Base
from valerie.errors import Conflict


@pytest.fixture
def empty(tmp_path: Path) -> Engine:
    return open_database(f"sqlite:///{tmp_path / 'valerie.sqlite3'}")


def at_revision(engine: Engine, revision: str) -> None:
    """Make a database with a run that another version wrote."""
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL PRIMARY KEY)"))
        connection.execute(text("INSERT INTO alembic_version VALUES (:revision)"), {"revision": revision})
        connection.execute(text("CREATE TABLE runs (id VARCHAR(32) PRIMARY KEY, spec JSON)"))
        connection.execute(text("INSERT INTO runs VALUES ('r1', '{}')"))


def contents(engine: Engine) -> dict[str, list[tuple[object, ...]]]:
    with engine.begin() as connection:
        tables = list(connection.execute(text("SELECT name, sql FROM sqlite_master ORDER BY name")))
        rows = {name: [tuple(row) for row in connection.execute(text(f'SELECT * FROM "{name}"'))]
                for name, sql in tables if sql and sql.startswith("CREATE TABLE")}  # fmt: skip
        return {"": [tuple(table) for table in tables], **rows}


def test_the_migrations_make_the_tables_of_the_models(empty: Engine) -> None:
    migrate(empty)
    with empty.begin() as connection:
        context = MigrationContext.configure(connection)
        assert compare_metadata(context, Base.metadata) == []
        assert context.get_current_revision() == REVISION


def test_a_second_migration_changes_nothing(empty: Engine) -> None:
    migrate(empty)
    before = contents(empty)
    migrate(empty)
    assert contents(empty) == before


def test_a_database_of_the_first_release_keeps_its_rows(empty: Engine) -> None:
    with empty.begin() as connection:
        config = Config()
        config.set_main_option("script_location", str(Path(migrations.__file__).parent))
        config.attributes["connection"] = connection
        command.upgrade(config, "0001_initial")
        connection.execute(
            text(
                "INSERT INTO workers (id, stage, host, pid, offers, started_at, seen_at) "
                "VALUES ('w1', 'render', 'h', 1, '[]', 1.0, 2.0)"
            )
        )
    migrate(empty)
    require_current(empty)
    with empty.begin() as connection:
        assert connection.execute(text("SELECT id, seen_at, resting FROM workers")).one() == ("w1", 2.0, None)
        assert connection.execute(text("SELECT count(*) FROM tokens")).scalar() == 0


@pytest.mark.parametrize("revision", ["0001", "0002", "0003", "0004", "0006"])
def test_a_database_from_before_the_first_release_is_refused_unchanged(empty: Engine, revision: str) -> None:
    at_revision(empty, revision)
    before = contents(empty)
    for use in (migrate, require_current):
        with pytest.raises(Conflict, match=r"before VALERIE 0\.1\.0.*VALERIE_DATABASE_URL.*submit its specs again"):
            use(empty)
    assert contents(empty) == before


def test_a_database_of_a_newer_version_is_refused_unchanged(empty: Engine) -> None:
    at_revision(empty, "0099_of_tomorrow")
    before = contents(empty)
    for use in (migrate, require_current):
        with pytest.raises(Conflict, match="written by a newer one"):
            use(empty)
    assert contents(empty) == before


def test_a_worker_does_not_start_on_an_empty_database(empty: Engine) -> None:
    with pytest.raises(Conflict, match="run `valerie migrate`"):
        require_current(empty)
