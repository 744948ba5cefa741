"""Where the rows of a run are read: in the database, or in a database of their own if the run is archived."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Final, Protocol

from sqlalchemy import Connection, Engine, select

from valerie.db.engine import reading
from valerie.db.models import Run
from valerie.db.statements import within
from valerie.errors import NotFound
from valerie.runs.products.archive import Archive

#: Execution option of engines: the `Archives` of their deployment.
ARCHIVES: Final = "valerie_archives"


class Archives(Protocol):
    """The archives of a deployment."""

    def rows(self, run_id: str, parent_run: str | None, archive: Archive) -> Engine:
        """Return a database, only to be read, with all rows of an archived run.

        Its connections raise `NotFound` if the archive is gone.
        """
        ...

    def stored(self, archives: Mapping[str, Archive], digests: Collection[str]) -> set[str]:
        """Return those ``digests`` whose objects some archives, by run, need."""
        ...


@contextmanager
def reading_run(engine: Engine, run_id: str) -> Iterator[Connection]:
    """Open a transaction that reads one consistent state of the row of a run, its other rows and its marks.

    If the run is archived, these are in a database without other runs. If there is no such run, queries find nothing.
    """
    with ExitStack() as stack:
        yield _opened(stack, engine, run_id)


def _opened(stack: ExitStack, engine: Engine, run_id: str) -> Connection:
    gone: Archive | None = None
    while True:
        with ExitStack() as attempt:
            connection = attempt.enter_context(reading(engine))
            if connection.dialect.name == "postgresql":
                # Rows that leave the database while they are read stay visible.
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            row = connection.execute(select(Run.parent_run, Run.archive).where(Run.id == run_id)).first()
            parent_run, archive = (None, None) if row is None else row
            if archive is not None:
                attempt.close()
                if archive == gone:
                    raise NotFound("archive of run", run_id)
                archives: Archives = engine.get_execution_options()[ARCHIVES]
                try:
                    connection = attempt.enter_context(reading(archives.rows(run_id, parent_run, archive)))
                except NotFound:
                    # Its rows may have come back meanwhile.
                    gone = archive
                    continue
            stack.push(attempt.pop_all())
            return connection


def read_archived_digests(engine: Engine) -> None:
    """Have the archives read what they store, so that `stored_in_archives` reads no files while rows are locked."""
    with reading(engine) as connection:
        stored_in_archives(connection, ())


def stored_in_archives(connection: Connection, digests: Collection[str], *, project: str = "") -> set[str]:
    """Return those ``digests`` whose objects archived runs need; those of a project, if it is not empty."""
    query = select(Run.id, Run.archive).where(Run.archive.is_not(None), within(Run, project))
    archived = {run_id: archive for run_id, archive in connection.execute(query) if archive is not None}
    if not archived:
        return set()
    archives: Archives = connection.get_execution_options()[ARCHIVES]
    return archives.stored(archived, digests)
