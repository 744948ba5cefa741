"""Databases of this version, of a newer one, and of the time before the first release."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, text

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


@pytest.mark.parametrize("revision", ["0001", "0006", "0001_initial", "0005_deliveries"])
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


def without_measure(engine: Engine) -> None:
    """Leave the tables of a version that lacks the measure ``contrast``, with a person's light."""
    migrate(engine)
    with engine.begin() as connection:
        connection.execute(text("ALTER TABLE person_lights DROP COLUMN contrast"))
        connection.execute(
            text(
                "INSERT INTO products (digest, kind, state, route, cache_group, turn, attempts) "
                "VALUES ('p1', 'light', 'done', 'render', 'g', 0.0, 1)"
            )
        )
        connection.execute(
            text(
                "INSERT INTO person_lights (product, instance_id, irradiance, shadow_share) VALUES ('p1', 24001, 0.75, 0.25)"
            )
        )


def test_a_new_measure_gets_its_column_and_is_empty_in_old_rows(empty: Engine) -> None:
    without_measure(empty)
    with pytest.raises(Conflict, match=r"lacks columns of measures.*run `valerie migrate`"):
        require_current(empty)
    migrate(empty)
    require_current(empty)
    with empty.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
        query = text("SELECT irradiance, shadow_share, contrast FROM person_lights")
        assert connection.execute(query).one() == (0.75, 0.25, None)


def test_a_measure_of_a_newer_version_disturbs_nobody(empty: Engine) -> None:
    migrate(empty)
    with empty.begin() as connection:
        connection.execute(text("ALTER TABLE person_lights ADD COLUMN glare FLOAT"))
    before = contents(empty)
    require_current(empty)
    migrate(empty)
    assert contents(empty) == before


def test_a_worker_does_not_start_on_an_empty_database(empty: Engine) -> None:
    with pytest.raises(Conflict, match="run `valerie migrate`"):
        require_current(empty)
