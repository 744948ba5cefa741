"""Backups of a deployment in one folder; `tests/integration/test_backup_postgres.py` has the other database."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.world.blank import Pipeline
from tests.world.world import settings_of
from valerie.errors import Conflict, InvalidInput, NotFound
from valerie.pipeline.base.context import open_context
from valerie.pipeline.control.backup import back_up, restore
from valerie.storage.keys import PRODUCTS


def keys(pipeline: Pipeline, prefix: str = "") -> set[str]:
    return {info.key for info in pipeline.context.store.list(prefix)}


def restored(folder: Path, backup: Path, like: Pipeline) -> Pipeline:
    settings = like.settings.model_copy(
        update={"database_url": f"sqlite:///{folder}/valerie.sqlite3", "artifacts_url": str(folder / "artifacts")}
    )
    restore(settings, backup)
    world = object.__new__(Pipeline)
    world.settings, world.context = settings, open_context(settings)
    return world


def test_a_restored_deployment_has_the_same_rows_and_results(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run = completed
    contents = back_up(pipeline.context, tmp_path / "backup")
    other = restored(tmp_path / "other", tmp_path / "backup", pipeline)
    assert other.row(run) == pipeline.row(run)
    assert [tuple(row) for row in other.products()] == [tuple(row) for row in pipeline.products()]
    assert keys(other) == keys(pipeline) - keys(pipeline, PRODUCTS)
    assert contents.objects == len(keys(other)) > 0


def test_products_are_part_of_it_on_request(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, _ = completed
    back_up(pipeline.context, tmp_path / "backup", products=True)
    other = restored(tmp_path / "other", tmp_path / "backup", pipeline)
    assert keys(other) == keys(pipeline)
    assert all(other.context.store.get(key) == pipeline.context.store.get(key) for key in keys(pipeline))


def test_a_backup_needs_an_empty_folder(pipeline: Pipeline, tmp_path: Path) -> None:
    (tmp_path / "backup").mkdir()
    (tmp_path / "backup" / "mine.txt").write_text("mine")
    with pytest.raises(Conflict, match="not empty"):
        back_up(pipeline.context, tmp_path / "backup")


def test_a_deployment_is_never_overwritten(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, _ = completed
    back_up(pipeline.context, tmp_path / "backup")
    with pytest.raises(Conflict, match="empty deployment"):
        restore(pipeline.settings, tmp_path / "backup")


def test_an_unfinished_backup_is_refused(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, _ = completed
    back_up(pipeline.context, tmp_path / "backup")
    (tmp_path / "backup" / "backup.json").unlink()
    with pytest.raises(NotFound, match="unfinished"):
        restore(settings_of(tmp_path / "other"), tmp_path / "backup")


def test_a_backup_of_sqlite_does_not_fit_postgres(completed: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, _ = completed
    back_up(pipeline.context, tmp_path / "backup")
    settings = settings_of(tmp_path / "other", database_url="postgresql://nobody@127.0.0.1/none")
    with pytest.raises(InvalidInput, match="kind of database"):
        restore(settings, tmp_path / "backup")
