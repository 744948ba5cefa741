"""Column types, against SQLite (Postgres: tests/integration/test_tokens_postgres.py)."""

from datetime import UTC, datetime, timedelta, timezone

from sqlalchemy import Column, MetaData, Table, create_engine, insert, select

from valerie.db.column_types import UtcMoment


def test_a_moment_returns_in_utc_from_a_database_that_stores_no_time_zone() -> None:
    table = Table("moments", MetaData(), Column("at", UtcMoment()))
    noon = datetime(2026, 6, 1, 12, tzinfo=timezone(timedelta(hours=2)))
    with create_engine("sqlite://").connect() as connection:
        table.create(connection)
        connection.execute(insert(table), [{"at": noon}, {"at": None}])
        moments = connection.scalars(select(table.c.at)).all()
        earlier = connection.scalars(select(table.c.at).where(table.c.at <= noon.astimezone(UTC))).all()
    assert moments == [datetime(2026, 6, 1, 10, tzinfo=UTC), None]
    assert [moment.tzinfo for moment in moments if moment] == [UTC]
    assert earlier == [noon]
