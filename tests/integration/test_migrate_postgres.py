"""A measure that is newer than a database on Postgres."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text

from valerie.db.engine import open_database
from valerie.db.migrate import migrate, require_current
from valerie.db.models import Base
from valerie.errors import Conflict

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


def test_processes_that_start_at_once_add_its_column_once(new_database: Callable[[], str]) -> None:
    engine = open_database(new_database())
    migrate(engine)
    with engine.begin() as connection:
        connection.execute(text("ALTER TABLE person_views DROP COLUMN aspect_deg"))
    with pytest.raises(Conflict, match="lacks columns of measures"):
        require_current(engine)
    with ThreadPoolExecutor(4) as processes:
        list(processes.map(lambda _: migrate(engine), range(4)))
    require_current(engine)
    with engine.begin() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    engine.dispose()
