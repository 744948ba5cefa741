"""Archive ended runs: their rows move from the database into Parquet files beside their results, and back."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from valerie.db import archiving, copying, runs, sweeping, usage
from valerie.db.archives import reading_run
from valerie.db.engine import database_time, reading, translated, writing
from valerie.db.models import REVISION, Base
from valerie.db.runs import RunRow
from valerie.errors import CorruptArtifact
from valerie.pipeline.base import row_files
from valerie.pipeline.base.context import Context
from valerie.pipeline.control.quotas import CPU_PERIOD
from valerie.runs.products.archive import Archive
from valerie.runs.products.states import ProductKind

#: Variants, and products, whose rows are deleted in one transaction.
_VARIANTS: Final = 200
_PRODUCTS: Final = 500


def archive_run(context: Context, run_id: str) -> Archive:
    """Move the rows of an ended run into the artifact store. Repeating it finishes what a killed process began.

    The files are complete before the run is read from them, and its rows leave after that.

    Args:
        context: of the deployment.
        run_id: id of the run.

    Raises:
        NotFound: no such run.
        Conflict: it has not ended, or a study or run that needs it has not; or it changed meanwhile.
        CorruptArtifact: the store does not return what was written.
        StorageFull, StorageUnavailable: the store cannot be written.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        archiving.require_unneeded(connection, run)
    archive = run.archive or _write(context, run)
    _remove_rows(context, run)
    return archive


def ended_runs(context: Context, *, days: int) -> list[str]:
    """Return the runs that ended so many days ago or earlier and are not archived, oldest first."""
    with reading(context.engine) as connection:
        return archiving.ended_before(connection, database_time(connection) - days * 86_400)


def restore_rows(context: Context, run_id: str) -> None:
    """Move the rows of an archived run back into the database. Repeating it finishes what a killed process began.

    The files stay until `gc` removes them: somebody may read them.

    Raises:
        NotFound: no such run, or its archive is gone.
        Conflict: a product of the run is being made again for another one, or has failed there.
        CorruptArtifact: a file is not the one that was written.
    """
    with reading(context.engine) as connection:
        if runs.get(connection, run_id).archive is None:
            return
    # Until the last transaction, the run is read from its archive.
    with reading_run(context.engine, run_id) as rows, translated(), context.engine.connect() as target:
        copying.copy_contents(rows, target, run_id, after_chunk=target.commit)
        runs.set_values(target, run_id, archive=None)
        target.commit()


def _write(context: Context, run: RunRow) -> Archive:
    with TemporaryDirectory(prefix="valerie-archive-") as folder:
        path, again = Path(folder, "rows.sqlite3"), Path(folder, "again.sqlite3")
        engine = row_files.open_new(path)
        Base.metadata.create_all(engine)
        with reading_run(context.engine, run.id) as connection, engine.begin() as target:
            run = runs.get(connection, run.id)
            copying.copy_contents(connection, target, run.id)
            now = database_time(connection)
            own = usage.unshared(connection, run, since=now - CPU_PERIOD.total_seconds())
        tables = row_files.write_files(path, context.store, run.id)
        row_files.read_files(again, context.store, run.id, REVISION, tables)
        if table := row_files.differing_table(path, again):
            raise CorruptArtifact(f"the file of table {table} of run {run.id} does not have the rows of the database")
    archive = Archive(at=now, revision=REVISION, tables=tables, stored_bytes=own.bytes, cpu_seconds=own.cpu_seconds)
    with writing(context.engine) as connection:
        archiving.name_archive(connection, run, archive)
    return archive


def _remove_rows(context: Context, run: RunRow) -> None:
    """Delete the rows of an archived run in short transactions; products that other runs link to stay."""
    for first in range(0, run.next_index, _VARIANTS):
        with writing(context.engine) as connection:
            archiving.remove_variants(connection, run.id, first, first + _VARIANTS - 1)
    with writing(context.engine) as connection:
        archiving.remove_blocks(connection, run.id)
    with reading_run(context.engine, run.id) as rows:
        # Those of statics are few, and `gc` frees them; to find what is stored over one reads all products.
        digests = [p.digest for p in copying.needed_products(rows, run.id) if p.kind is not ProductKind.STATICS]
    for start in range(0, len(digests), _PRODUCTS):
        with writing(context.engine) as connection:
            some = sweeping.unlinked(connection, limit=_PRODUCTS, digests=digests[start : start + _PRODUCTS])
            sweeping.free(connection, [product.digest for product in some])
