"""Databases of earlier versions, brought to this one's tables."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import Engine, inspect, text

from valerie.db.engine import open_engine
from valerie.db.migrate import migrate

MIGRATIONS = Path(__file__).parents[3] / "migrations"
DIGEST = "0" * 32


def to(engine: Engine, revision: str, *, back: bool = False) -> None:
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        (command.downgrade if back else command.upgrade)(config, revision)


@pytest.fixture
def first(tmp_path: Path) -> Engine:
    """A database of the first revision with a truth that has a person."""
    engine = open_engine(f"sqlite:///{tmp_path / 'valerie.sqlite3'}")
    to(engine, "0001")
    with engine.begin() as connection:
        connection.execute(
            text(
                "INSERT INTO products (digest, kind, state, route, cache_group, attempts)"
                " VALUES (:d, 'truth', 'done', 'r', '', 1)"
            ),
            {"d": DIGEST},
        )
        connection.execute(
            text(
                "INSERT INTO person_views (truth, instance_id, pixel_area, pixel_area_percent, pixel_area_amodal)"
                " VALUES (:d, 24001, 5, 0.1, 5)"
            ),
            {"d": DIGEST},
        )
    return engine


def views(engine: Engine) -> int:
    with engine.begin() as connection:
        return int(connection.scalar(text("SELECT count(*) FROM person_views WHERE pixel_area = 5")) or 0)


def test_what_was_measured_survives_the_way_up_and_back(first: Engine) -> None:
    migrate(first)
    assert views(first) == 1
    assert "input_c" in {column["name"] for column in inspect(first).get_columns("products")}
    to(first, "0001", back=True)
    assert views(first) == 1
    assert "input_c" not in {column["name"] for column in inspect(first).get_columns("products")}
    first.dispose()
