"""A backup of a deployment on Postgres, restored into another database."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import inspect

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import write_box_street
from valerie.db import runs
from valerie.db.engine import open_engine, reading
from valerie.errors import Conflict
from valerie.pipeline.control.backup import back_up, restore

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


def test_a_backup_of_postgres_is_restored_into_an_empty_database(
    new_database: Callable[[], str], tmp_path: Path
) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    pipeline = Pipeline(tmp_path / "data", tmp_path / "assets", database_url=new_database())
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    back_up(pipeline.context, tmp_path / "backup")
    other = pipeline.settings.model_copy(
        update={"database_url": new_database(), "artifacts_url": str(tmp_path / "other")}
    )
    restore(other, tmp_path / "backup")
    engine = open_engine(other.database_url)
    with reading(engine) as connection:
        assert runs.get(connection, run) == pipeline.row(run)
    assert set(inspect(engine).get_table_names()) == set(inspect(pipeline.context.engine).get_table_names())
    with pytest.raises(Conflict, match="has tables"):
        restore(other, tmp_path / "backup")
    engine.dispose()
    pipeline.context.engine.dispose()
