"""Copies of a run in another deployment; `tests/integration/test_backup_postgres.py` has the other database."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text

from tests.world.blank import SMALL, Pipeline
from tests.world.world import settings_of
from valerie.db import long_table, marks
from valerie.db.engine import reading, writing
from valerie.db.migrate import migrate
from valerie.errors import Conflict, NotFound
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.copy_run import copy_run


@pytest.fixture
def other(tmp_path: Path) -> Context:
    context = open_context(settings_of(tmp_path / "other"))
    migrate(context.engine)
    return context


def contents(context: Context, run: str) -> list[object]:
    """Return the rows of the long table, and all stored objects with their bytes."""
    with reading(context.engine) as connection:
        rows = list(long_table.rows(connection, run))
    return [rows, {info.key: context.store.get(info.key) for info in context.store.list()}]


def counts(context: Context) -> dict[str, int]:
    tables = ("runs", "blocks", "variants", "products", "frames", "evaluations", "person_views", "scores", "tags")
    with reading(context.engine) as connection:
        return {table: connection.scalar(text(f"SELECT count(*) FROM {table}")) or 0 for table in tables}


def test_a_copy_has_the_rows_and_the_objects_of_the_run_and_no_more(
    completed: tuple[Pipeline, str], other: Context
) -> None:
    pipeline, run = completed
    first = (contents(pipeline.context, run), counts(pipeline.context))
    unlike = pipeline.submit({**SMALL, "seed": 5, "resolution": {"width": 32, "height": 18}})
    assert pipeline.run(unlike) == "completed"
    copied = copy_run(pipeline.context, other, run)
    assert (contents(other, run), counts(other)) == first
    assert copied.objects == len(list(other.store.list()))
    assert copied.bytes == sum(info.size for info in other.store.list())


def test_nothing_of_a_copy_is_garbage_and_all_of_it_goes_with_the_run(
    completed: tuple[Pipeline, str], other: Context
) -> None:
    pipeline, run = completed
    copy_run(pipeline.context, other, run)
    before = contents(other, run)
    assert gc.collect(other).products == 0
    assert contents(other, run) == before
    lifecycle.delete(other, run)
    gc.collect(other)
    assert set(counts(other).values()) == {0}
    assert list(other.store.list()) == []


def test_a_run_is_copied_once(completed: tuple[Pipeline, str], other: Context) -> None:
    pipeline, run = completed
    copy_run(pipeline.context, other, run)
    before = contents(other, run), counts(other)
    with pytest.raises(Conflict, match="already"):
        copy_run(pipeline.context, other, run)
    assert (contents(other, run), counts(other)) == before


def test_products_that_two_runs_share_are_copied_with_the_first(
    completed: tuple[Pipeline, str], other: Context
) -> None:
    pipeline, run = completed
    child = pipeline.submit({**SMALL, "name": "again", "parent_run": run})
    assert pipeline.run(child) == "completed"
    copy_run(pipeline.context, other, run)
    products = counts(other)["products"]
    copy_run(pipeline.context, other, child)
    assert counts(other)["products"] == products
    with reading(other.engine) as connection:
        assert len(list(long_table.rows(connection, child))) == len(list(long_table.rows(connection, run)))
        assert connection.scalar(text("SELECT parent_run FROM runs WHERE name = 'again'")) == run


def test_a_child_without_its_parent_has_none(completed: tuple[Pipeline, str], other: Context) -> None:
    pipeline, run = completed
    child = pipeline.submit({**SMALL, "name": "again", "parent_run": run})
    assert pipeline.run(child) == "completed"
    copy_run(pipeline.context, other, child)
    with reading(other.engine) as connection:
        assert connection.scalar(text("SELECT parent_run FROM runs")) is None


def test_a_run_at_work_is_not_copied_and_a_cancelled_one_goes_on_in_its_copy(
    pipeline: Pipeline, pipelines: Callable[..., Pipeline]
) -> None:
    elsewhere = pipelines("other")
    run = pipeline.submit(SMALL)
    pipeline.run(run, until=("running",))
    with pytest.raises(Conflict, match="running"):
        copy_run(pipeline.context, elsewhere.context, run)
    lifecycle.cancel(pipeline.context, run)
    copy_run(pipeline.context, elsewhere.context, run)
    lifecycle.resume(elsewhere.context, run)
    assert elsewhere.run(run) == "completed"
    lifecycle.resume(pipeline.context, run)
    assert pipeline.run(run) == "completed"
    assert contents(elsewhere.context, run)[0] == contents(pipeline.context, run)[0]


def test_a_product_that_is_unfinished_there_is_a_conflict_that_changes_nothing(
    completed: tuple[Pipeline, str], pipelines: Callable[..., Pipeline]
) -> None:
    pipeline, run = completed
    elsewhere = pipelines("other")
    same = elsewhere.submit(SMALL)
    elsewhere.run(same, until=("running",))
    before = counts(elsewhere.context)
    with pytest.raises(Conflict, match="where its rows would go"):
        copy_run(pipeline.context, elsewhere.context, run)
    assert counts(elsewhere.context) == before
    assert elsewhere.run(same) == "completed"
    copy_run(pipeline.context, elsewhere.context, run)
    assert counts(elsewhere.context)["runs"] == 2


def test_a_run_that_does_not_exist_is_not_found(pipeline: Pipeline, other: Context) -> None:
    with pytest.raises(NotFound):
        copy_run(pipeline.context, other, "0" * 32)


def test_marks_are_copied(completed: tuple[Pipeline, str], other: Context) -> None:
    pipeline, run = completed
    with writing(pipeline.context.engine) as connection:
        connection.execute(
            text("INSERT INTO tags (run_id, kind, name, tag) VALUES (:run, 'run', '', 'night')"), {"run": run}
        )
    copy_run(pipeline.context, other, run)
    with reading(other.engine) as connection:
        assert marks.tags_of_runs(connection, [run]) == {run: ["night"]}
