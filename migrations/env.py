"""What Alembic runs: the models' metadata, on the connection that `valerie.db.migrate` or the command line gives."""

from __future__ import annotations

from alembic import context

from valerie.db.engine import open_engine
from valerie.db.models import Base


def run() -> None:
    connection = context.config.attributes.get("connection")
    if connection is not None:
        _migrate(connection)
        return
    from valerie.settings import load_settings

    engine = open_engine(load_settings().database_url)
    with engine.begin() as connection:
        _migrate(connection)
    engine.dispose()


def _migrate(connection: object) -> None:
    # Batch mode: SQLite can alter a table only by writing it anew.
    context.configure(connection=connection, target_metadata=Base.metadata, render_as_batch=True)
    with context.begin_transaction():
        context.run_migrations()


run()
