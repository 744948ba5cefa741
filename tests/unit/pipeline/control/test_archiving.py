"""Runs whose rows are in the artifact store; `tests/unit/services/api/test_archived.py` has what the API shows of them."""

from __future__ import annotations

import hashlib
import io
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from sqlalchemy import insert, inspect, text

from tests.world.archived import counts_of, rows_of
from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import spec
from tests.world.world import settings_of
from valerie.db import archiving as queries
from valerie.db import copying, frames, links, marks, runs, sweeping
from valerie.db.archives import reading_run
from valerie.db.engine import database_moment, open_database, reading, writing
from valerie.db.migrate import create, migrate
from valerie.db.models import Study, StudyBatch
from valerie.errors import Conflict, CorruptArtifact, NotFound, StorageUnavailable
from valerie.pipeline.base import row_files
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.archiving import archive_run, ended_runs, restore_rows
from valerie.pipeline.control.backup import back_up, restore
from valerie.pipeline.control.copy_run import copy_run
from valerie.pipeline.control.marking import put_mark
from valerie.pipeline.control.quotas import quotas_of
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.marks import Mark, Subject
from valerie.runs.products.archive import ArchivedTable
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.study.study_document import parse_study
from valerie.storage.keys import archive_key

#: A study of the asset of `SMALL`.
STUDY = {
    "name": "s",
    "asset": "box-street",
    "vary": [["person-1.pos.y", "UNIFORM", 2, 9]],
    "functions": ["blank"],
    "measure": "min(pacc) >= 0.5",
    "goal": "estimate",
    "budget": {"variants": 256},
}


def long_table(context: Context, run: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = read_table(context.engine, read_run(context, run)).arrow.to_pylist()
    return rows


def objects(context: Context) -> set[str]:
    return {info.key for info in context.store.list("products")}


def collect(context: Context) -> None:
    """Remove garbage as two hours later, when objects are old enough."""
    gc.collect(context, now=context.store.now() + timedelta(hours=2))


class KilledError(Exception):
    """The process ends here."""


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize(
    ("module", "name"),
    [
        (row_files, "write_files"),
        (row_files, "read_files"),
        (queries, "name_archive"),
        (queries, "remove_variants"),
        (queries, "remove_blocks"),
        (sweeping, "free"),
    ],
)
def test_a_run_is_whole_wherever_archiving_is_killed_and_a_second_call_finishes_it(
    completed: tuple[Pipeline, str], monkeypatch: pytest.MonkeyPatch, module: Any, name: str, after: bool
) -> None:
    pipeline, run = completed
    context = pipeline.context
    before, rows = long_table(context, run), rows_of(context.engine)
    step = getattr(module, name)

    def killed(*arguments: Any, **keywords: Any) -> None:
        if after:
            step(*arguments, **keywords)
        raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(module, name, killed)
        with pytest.raises(KilledError):
            archive_run(context, run)
    assert long_table(context, run) == before
    collect(context)
    assert long_table(context, run) == before
    archive_run(context, run)
    assert sum(counts_of(context.engine).values()) <= 1
    assert long_table(context, run) == before
    restore_rows(context, run)
    assert rows_of(context.engine) == rows


@pytest.mark.parametrize("chunks", [1, 2, 4, 6])
def test_a_run_is_whole_wherever_its_return_is_killed_and_either_way_can_be_finished(
    completed: tuple[Pipeline, str], monkeypatch: pytest.MonkeyPatch, chunks: int
) -> None:
    pipeline, run = completed
    context = pipeline.context
    before, rows = long_table(context, run), rows_of(context.engine)
    copy = copying.copy_contents

    def killed(*arguments: Any, after_chunk: Callable[[], None], **keywords: Any) -> None:
        left = iter(range(chunks))

        def one() -> None:
            if next(left, None) is None:
                raise KilledError
            after_chunk()

        copy(*arguments, after_chunk=one, **keywords)
        raise KilledError

    archive_run(context, run)
    for finish in (archive_run, restore_rows):
        with monkeypatch.context() as patch:
            patch.setattr(copying, "copy_contents", killed)
            with pytest.raises(KilledError):
                restore_rows(context, run)
        assert long_table(context, run) == before
        collect(context)
        assert long_table(context, run) == before
        finish(context, run)
        assert long_table(context, run) == before
    assert rows_of(context.engine) == rows


def test_gc_keeps_what_an_archived_run_needs_until_it_is_deleted(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    context = pipeline.context
    before = objects(context)
    archive_run(context, run)
    collect(context)
    assert objects(context) == before
    assert {one.verdict for one in replay_frame(context, FrameKey(run, 0, 0))} == {"equal"}
    lifecycle.delete(context, run)
    collect(context)
    assert list(context.store.list()) == []
    assert set(counts_of(context.engine).values()) == {0}


def test_files_of_a_run_that_is_no_longer_archived_are_garbage(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    context = pipeline.context
    others = {info.key for info in context.store.list()}
    archive_run(context, run)
    collect(context)
    assert {info.key for info in context.store.list()} > others
    restore_rows(context, run)
    collect(context)
    assert {info.key for info in context.store.list()} == others


def test_products_that_another_run_shares_stay_and_outlive_it(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    context = pipeline.context
    child = pipeline.submit({**SMALL, "name": "again", "parent_run": run})
    assert pipeline.run(child) == "completed"
    before, rows = {name: long_table(context, name) for name in (run, child)}, rows_of(context.engine)
    stored = objects(context)
    archive_run(context, run)
    counts = counts_of(context.engine)
    assert counts["products"] == len(rows["products"])
    assert counts["frames"] == len(rows["frames"]) // 2
    assert {name: long_table(context, name) for name in (run, child)} == before
    archive_run(context, child)
    assert {name: long_table(context, name) for name in (run, child)} == before
    lifecycle.delete(context, child)
    collect(context)
    assert objects(context) == stored
    assert long_table(context, run) == before[run]
    assert {one.verdict for one in replay_frame(context, FrameKey(run, 0, 0))} == {"equal"}
    restore_rows(context, run)
    assert long_table(context, run) == before[run]


def test_a_later_run_makes_the_products_of_an_archived_one_again_and_both_agree(
    completed: tuple[Pipeline, str],
) -> None:
    pipeline, run = completed
    context = pipeline.context
    before, made = long_table(context, run), pipeline.made()
    archive_run(context, run)
    collect(context)
    later = pipeline.submit({**SMALL, "name": "later"})
    pipeline.run(later, until=("running",))
    with pytest.raises(Conflict, match="where its rows would go"):
        restore_rows(context, run)
    assert long_table(context, run) == before
    assert pipeline.run(later) == "completed"
    assert pipeline.made() == made
    assert [
        {**row, "run_id": run, "frame_id": row["frame_id"].replace(later, run)} for row in long_table(context, later)
    ] == before
    restore_rows(context, run)
    assert long_table(context, run) == before


def test_what_a_cancelled_run_gave_up_comes_back_with_an_archived_one(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    context = pipeline.context
    rows = rows_of(context.engine)
    archive_run(context, run)
    later = pipeline.submit({**SMALL, "name": "later"})
    pipeline.step(0)
    lifecycle.cancel(context, later)
    with writing(context.engine) as connection:
        connection.execute(text("UPDATE products SET state = 'parked' WHERE state IN ('waiting', 'ready')"))
    restore_rows(context, run)
    lifecycle.delete(context, later)
    assert rows_of(context.engine)["products"] == rows["products"]


def test_pictures_of_an_archived_run_outlive_a_run_that_keeps_none(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    context = pipeline.context
    stored = objects(context)
    archive_run(context, run)
    later = pipeline.submit({**SMALL, "name": "later", "retention": "numbers"})
    assert pipeline.run(later) == "completed"
    collect(context)
    assert objects(context) == stored
    assert {one.verdict for one in replay_frame(context, FrameKey(run, 0, 0))} == {"equal"}


def test_a_quota_counts_what_an_archived_run_stores(pipeline: Pipeline) -> None:
    settings = pipeline.settings.model_copy(update={"max_owner_gigabytes": 1.0, "max_owner_cpu_hours": 1.0})
    run = pipeline.submit(SMALL, owner="Anna")
    assert pipeline.run(run) == "completed"
    context = pipeline.context

    def used() -> list[float]:
        with reading(context.engine) as connection:
            return [quota.used for quota in quotas_of(connection, settings, "Anna", "")]

    before = used()
    assert min(before) > 0
    archive_run(context, run)
    collect(context)
    assert used() == pytest.approx(before)
    restore_rows(context, run)
    assert used() == pytest.approx(before)


def test_products_of_an_archived_run_exist_for_its_project_only(pipeline: Pipeline) -> None:
    run = pipeline.submit(SMALL, project="radar")
    assert pipeline.run(run) == "completed"
    with reading(pipeline.context.engine) as connection:
        digest = frames.get(connection, FrameKey(run, 0, 0)).products.truth

    def known() -> list[bool]:
        with reading(pipeline.context.engine) as connection:
            return [links.has_product(connection, digest, project=name) for name in ("radar", "camera")]

    assert known() == [True, False]
    archive_run(pipeline.context, run)
    assert known() == [True, False]


def test_a_study_that_has_not_ended_keeps_its_runs(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    engine = pipeline.context.engine
    with writing(engine) as connection:
        moment, document = database_moment(connection), parse_study(STUDY)
        columns = {"asset_digest": "0" * 32, "by_hand": True, "created_at": moment}
        connection.execute(insert(Study).values(id="s1", name="s", state="running", document=document, **columns))
        values = {"count": 1, "points": [[0.5]], "rejected": [], "reason": "", "basis": "0" * 32, "based_on": 0}
        connection.execute(insert(StudyBatch).values(study_id="s1", number=0, run_id=run, **values))
    with pytest.raises(Conflict, match="belongs to study s1, which is running"):
        archive_run(pipeline.context, run)
    with writing(engine) as connection:
        connection.execute(text("UPDATE studies SET state = 'stopped'"))
    archive_run(pipeline.context, run)


def test_a_copy_of_an_archived_run_is_whole_and_not_archived(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run = completed
    others = [open_context(settings_of(tmp_path / name)) for name in ("before", "after")]
    for other, archive in zip(others, (False, True), strict=True):
        migrate(other.engine)
        if archive:
            archive_run(pipeline.context, run)
        copy_run(pipeline.context, other, run)
    first, second = ((rows_of(other.engine), {info.key for info in other.store.list()}) for other in others)
    assert first == second
    assert first[0]["frames"]


def test_a_run_that_is_archived_again_has_its_present_marks(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run = completed
    other = open_context(settings_of(tmp_path / "other"))
    migrate(other.engine)
    archive_run(pipeline.context, run)
    restore_rows(pipeline.context, run)
    put_mark(pipeline.context, run, Subject(), Mark(tags=("night",)))
    archive_run(pipeline.context, run)
    copy_run(pipeline.context, other, run)
    with reading(other.engine) as connection:
        assert marks.tags_of_runs(connection, [run]) == {run: ["night"]}


def test_a_backup_has_archived_runs(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run = completed
    before = long_table(pipeline.context, run)
    archive_run(pipeline.context, run)
    back_up(pipeline.context, tmp_path / "backup")
    settings = settings_of(tmp_path / "other", asset_dir=pipeline.settings.asset_dir, testing_engines=True)
    restore(settings, tmp_path / "backup")
    context = open_context(settings)
    assert long_table(context, run) == before
    context.engine.dispose()


def test_a_deleted_parent_is_forgotten_by_an_archived_child(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    child = pipeline.submit({**SMALL, "name": "again", "parent_run": run})
    with pytest.raises(Conflict, match="goes on from"):
        archive_run(pipeline.context, run)
    assert pipeline.run(child) == "completed"
    archive_run(pipeline.context, child)
    parents = []
    for _ in range(2):
        with reading_run(pipeline.context.engine, child) as connection:
            parents.append(runs.get(connection, child).parent_run)
        lifecycle.delete(pipeline.context, run) if len(parents) == 1 else None
    assert parents == [run, None]


def test_two_processes_read_an_archived_run_at_once(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    other = pipeline.submit({**SMALL, "name": "other", "seed": 7})
    assert pipeline.run(other) == "completed"
    before = [len(long_table(pipeline.context, name)) for name in (run, other)]
    for name in (run, other):
        archive_run(pipeline.context, name)
    # No file fits into the folder, so that the processes delete each other's.
    program = """
import sys
from valerie.db.archives import ARCHIVES
from valerie.pipeline.base.archives import StoredArchives
from valerie.pipeline.base.context import open_context
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.reading.tables import read_table
from valerie.settings import load_settings
from valerie.storage.bounded_folder import BoundedFolder
context = open_context(load_settings(broker_url="memory://"))
folder = BoundedFolder(context.settings.data_dir / "archives", max_bytes=1)
context.engine.update_execution_options(**{ARCHIVES: StoredArchives(context.engine, context.store, folder)})
runs = sys.argv[1:]
print([[len(read_table(context.engine, read_run(context, run))) for run in runs] for _ in range(5)])
"""
    environment = {**pipeline.settings.environment(), "PYTHONPATH": ":".join(sys.path), "PATH": "/usr/bin:/bin"}
    processes = [
        subprocess.Popen([sys.executable, "-c", program, *order], env=environment, stdout=subprocess.PIPE)
        for order in ((run, other), (other, run))
    ]
    counts = [process.communicate(timeout=300)[0].decode().strip() for process in processes]
    assert counts == [str([before] * 5), str([before[::-1]] * 5)]


def test_a_file_that_is_not_the_written_one_is_refused_and_a_missing_one_is_not_found(
    completed: tuple[Pipeline, str],
) -> None:
    pipeline, run = completed
    context = pipeline.context
    before = long_table(context, run)
    archive_run(context, run)
    shutil.rmtree(pipeline.settings.data_dir / "archives")
    (key,) = (info.key for info in context.store.list(f"runs/{run}") if ".frames." in info.key)
    data = context.store.get(key)
    context.store.put(key, data[:-1] + bytes([data[-1] ^ 1]), replace=True)
    with pytest.raises(CorruptArtifact, match="frames"):
        long_table(context, run)
    context.store.delete(key)
    with pytest.raises(NotFound, match="archive"):
        long_table(context, run)
    context.store.put(key, data)
    assert long_table(context, run) == before


def with_columns(context: Context, run: str, name: str, table: ArchivedTable, columns: Sequence[str]) -> ArchivedTable:
    """Store a table's file again with some of its columns only."""
    buffer = io.BytesIO()
    file = pq.read_table(io.BytesIO(context.store.get(archive_key(run, name, table.sha256))))
    pq.write_table(file.select([column for column in file.column_names if column in columns]), buffer)
    data = buffer.getvalue()
    digest = hashlib.sha256(data).hexdigest()
    context.store.put(archive_key(run, name, digest), data)
    return ArchivedTable(rows=table.rows, bytes=len(data), sha256=digest)


def test_an_archive_of_an_older_revision_is_read(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run = completed
    context = pipeline.context
    before, rows = long_table(context, run), rows_of(context.engine)
    archive = archive_run(context, run)
    # The release had fewer columns.
    tables = dict(archive.tables)
    release = open_database(f"sqlite:///{tmp_path / 'release.sqlite3'}")
    create(release, "release_0_1_0")
    for name in archive.tables:
        if inspect(release).has_table(name):
            columns = [column["name"] for column in inspect(release).get_columns(name)]
            tables[name] = with_columns(context, run, name, archive.tables[name], columns)
    with writing(context.engine) as connection:
        old = archive.model_copy(update={"revision": "release_0_1_0", "tables": tables})
        runs.set_values(connection, run, archive=old)
    assert long_table(context, run) == before
    with writing(context.engine) as connection:
        runs.set_values(connection, run, archive=archive.model_copy(update={"revision": "of-the-future"}))
    with pytest.raises(Conflict, match="newer"):
        long_table(context, run)
    with writing(context.engine) as connection:
        runs.set_values(connection, run, archive=archive)
    restore_rows(context, run)
    assert rows_of(context.engine) == rows


def test_a_folder_that_cannot_be_written_is_named(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    archive_run(pipeline.context, run)
    shutil.rmtree(pipeline.settings.data_dir / "archives")
    (pipeline.settings.data_dir / "archives").write_text("")
    with pytest.raises(StorageUnavailable, match="archives"):
        long_table(pipeline.context, run)


def test_a_cancelled_run_comes_back_and_goes_on(pipeline: Pipeline) -> None:
    run = pipeline.submit(spec(xs=4, ys=3))
    pipeline.run(run, until=("running",))
    lifecycle.cancel(pipeline.context, run)
    archive_run(pipeline.context, run)
    with pytest.raises(Conflict, match="--undo"):
        lifecycle.resume(pipeline.context, run)
    restore_rows(pipeline.context, run)
    lifecycle.resume(pipeline.context, run)
    assert pipeline.run(run) == "completed"


def test_runs_that_ended_long_ago_are_listed(completed: tuple[Pipeline, str]) -> None:
    pipeline, run = completed
    pipeline.submit({**SMALL, "name": "waits"})
    assert ended_runs(pipeline.context, days=1) == []
    with writing(pipeline.context.engine) as connection:
        connection.execute(text("UPDATE runs SET finished_at = '2020-01-01 00:00:00' WHERE id = :run"), {"run": run})
    assert ended_runs(pipeline.context, days=90) == [run]
    archive_run(pipeline.context, run)
    assert ended_runs(pipeline.context, days=90) == []
