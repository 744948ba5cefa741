from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine

from valerie.db.engine import open_database
from valerie.db.migrate import migrate


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Engine]:
    """A migrated SQLite database."""
    engine = open_database(f"sqlite:///{tmp_path / 'valerie.sqlite3'}")
    migrate(engine)
    yield engine
    engine.dispose()
