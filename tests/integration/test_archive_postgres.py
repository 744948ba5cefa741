"""Archived runs of a deployment on Postgres: shown as before, read while they leave, back row for row."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from services.api.app import create_app
from tests.world.archived import answers, counts_of, rows_of
from tests.world.blank import SMALL, Pipeline
from tests.world.drawn import draw_runs
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.db import long_table
from valerie.db.archives import reading_run
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.archiving import archive_run, restore_rows

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


def test_archived_runs_are_shown_as_before_and_come_back(new_database: Callable[[], str], tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "data", database_url=new_database())
    drawn = draw_runs(settings)
    runs = [drawn.finished, drawn.failed]
    context = open_context(settings)
    with served(create_app(settings, control=False)) as api:
        assert api.put(f"/v1/runs/{runs[0]}/marks", json={"tags": ["night"], "note": "all of it"}).status_code == 200
        before = answers(api, runs)
    rows = rows_of(context.engine)
    for run in runs:
        archive_run(context, run)
    assert len(rows_of(context.engine)["products"]) < len(rows["products"])
    with served(create_app(settings, control=False)) as api:
        after = answers(api, runs)
    assert {address for address in before if before[address] != after[address]} == set()
    for run in runs:
        restore_rows(context, run)
    back = rows_of(context.engine)
    assert {name for name in rows if rows[name] != back[name]} == set()
    context.engine.dispose()


def test_a_reader_sees_all_rows_while_they_leave_and_gc_keeps_the_objects(pipeline: Pipeline) -> None:
    context = pipeline.context
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    child = pipeline.submit({**SMALL, "name": "again", "parent_run": run})
    assert pipeline.run(child) == "completed"
    stored = {info.key for info in context.store.list("products")}
    with reading_run(context.engine, run) as connection:
        before = sorted(long_table.rows(connection, run), key=repr)
        archive_run(context, run)
        assert sorted(long_table.rows(connection, run), key=repr) == before
    with reading_run(context.engine, run) as connection:
        assert sorted(long_table.rows(connection, run), key=repr) == before
    archive_run(context, child)
    gc.collect(context)
    assert counts_of(context.engine)["products"] == 0
    assert {info.key for info in context.store.list("products")} == stored
    lifecycle.delete(context, child)
    gc.collect(context)
    assert {info.key for info in context.store.list("products")} == stored
    restore_rows(context, run)
    with reading_run(context.engine, run) as connection:
        assert sorted(long_table.rows(connection, run), key=repr) == before
