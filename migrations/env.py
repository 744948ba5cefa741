"""Alembic's environment: the models' metadata, on the connection that `valerie.db.migrate` or the command line gives."""

from __future__ import annotations

from typing import Literal

from alembic import context
from alembic.autogenerate.api import AutogenContext
from sqlalchemy import Enum

from valerie.db.column_types import JsonDocument, UtcMoment
from valerie.db.engine import open_database
from valerie.db.models import Base


def run() -> None:
    connection = context.config.attributes.get("connection")
    if connection is not None:
        _migrate(connection)
        return
    from valerie.settings import load_settings

    engine = open_database(load_settings().database_url)
    with engine.begin() as connection:
        _migrate(connection)
    engine.dispose()


def _migrate(connection: object) -> None:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        # SQLite can alter a table only by writing it anew.
        render_as_batch=True,
        render_item=_render,
    )
    with context.begin_transaction():
        context.run_migrations()


def _render(kind: str, item: object, autogen_context: AutogenContext) -> str | Literal[False]:
    """Write our column types as what the databases know: a migration must not change with our code."""
    if kind == "type" and isinstance(item, JsonDocument):
        autogen_context.imports.add("from sqlalchemy.dialects import postgresql")
        return 'sa.JSON().with_variant(postgresql.JSONB(), "postgresql")'
    if kind == "type" and isinstance(item, UtcMoment):
        return "sa.DateTime(timezone=True)"
    if kind == "type" and isinstance(item, Enum):
        return f"sa.String(length={item.length})"
    return False


run()
