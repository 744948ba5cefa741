"""A backup of a deployment on Postgres, restored into another database, and a run copied to SQLite and back."""

from __future__ import annotations

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from sqlalchemy import inspect, text

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import write_box_street
from valerie.db import long_table, runs
from valerie.db.engine import open_database, reading, writing
from valerie.errors import Conflict
from valerie.pipeline.control.backup import back_up, restore
from valerie.pipeline.control.copy_run import copy_run

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


def test_a_backup_of_postgres_is_restored_into_an_empty_database(
    pipeline: Pipeline, new_database: Callable[[], str], tmp_path: Path
) -> None:
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    stage = f"stage_{os.getpid()}"
    with writing(pipeline.context.engine) as connection:
        connection.execute(text(f"CREATE ROLE {stage}"))
        connection.execute(text(f"GRANT SELECT ON runs TO {stage}"))
    back_up(pipeline.context, tmp_path / "backup")
    with writing(pipeline.context.engine) as connection:
        connection.execute(text(f"DROP OWNED BY {stage}"))
        connection.execute(text(f"DROP ROLE {stage}"))  # a new server does not know it
    other = pipeline.settings.model_copy(
        update={"database_url": new_database(), "artifacts_url": str(tmp_path / "other")}
    )
    restore(other, tmp_path / "backup")
    engine = open_database(other.database_url)
    with reading(engine) as connection:
        assert runs.get(connection, run) == pipeline.row(run)
    assert set(inspect(engine).get_table_names()) == set(inspect(pipeline.context.engine).get_table_names())
    with pytest.raises(Conflict, match="has tables"):
        restore(other, tmp_path / "backup")
    engine.dispose()


def test_a_run_is_copied_from_postgres_to_sqlite_and_to_another_postgres(
    new_database: Callable[[], str], tmp_path: Path
) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    worlds = [
        Pipeline(tmp_path / name, tmp_path / "assets", workers=name == "first", **settings)
        for name, settings in (
            ("first", {"database_url": new_database()}),
            ("second", {}),
            ("third", {"database_url": new_database()}),
        )
    ]
    run = worlds[0].submit(SMALL)
    assert worlds[0].run(run) == "completed"
    tables = []
    for source, target in pairwise(worlds):
        copy_run(source.context, target.context, run)
    for world in worlds:
        with reading(world.context.engine) as connection:
            tables.append(sorted(long_table.rows(connection, run), key=repr))
        world.context.engine.dispose()
    assert len(tables[0]) > 0
    assert tables[0] == tables[1] == tables[2]
