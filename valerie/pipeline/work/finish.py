"""The end of a run: stores its long table, the summary of the paper's section 6.2, the report and the environment."""

from __future__ import annotations

import errno
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from typing import Final

import orjson
import structlog
from sqlalchemy import Connection

from valerie.analysis.analyze import Analysis
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.db import processes, results, runs
from valerie.db.engine import database_moment, database_time, reading, writing
from valerie.db.results import FailedLink
from valerie.db.runs import RunRow
from valerie.errors import StorageFull, StorageUnavailable, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.environment import environment
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.pipeline.base.run_artifacts import ENVIRONMENT, REPORT, SUMMARY, TABLE_CSV, TABLE_PARQUET
from valerie.pipeline.reading.reports import read_results, write_report
from valerie.pipeline.work.retention import remove_pictures
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import RunState
from valerie.storage.keys import run_key

log = structlog.get_logger()

#: Errors of a disk that is full or cannot be written.
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
#: Stores a result of the run under a name.
Keep = Callable[[str, bytes], object]
#: Makes the results of a run from its failures, and keeps them.
Writer = Callable[[Context, RunRow, Sequence[FailedLink], Keep], None]


class _OvertakenError(Exception):
    """The lease ended, and another process finishes the run."""


def finish_run(context: Context, run_id: str, *, write: Writer | None = None) -> bool:
    """Store table, summary and report of a run whose products are all done or failed, and end it.

    One process at a time finishes a run. If its lease ends before, its successor finishes the run, and it keeps nothing more:
    the successor may know results that it does not know. If they cannot be stored at present, the run pauses; after another
    transient fault the control loop calls again.

    Args:
        context: context of this process.
        run_id: id of a run; nothing happens unless it is finishing.
        write: makes and keeps the results (default: `write_results`).

    Returns:
        False if there was nothing to do, another process does it, or a fault prevented it.
    """
    if _finishing(context, run_id) is None:
        return False
    with _alone(context, run_id) as alone:
        run = _finishing(context, run_id) if alone else None
        if run is None:
            return False
        return _finish(context, run, write or write_results)


def _finishing(context: Context, run_id: str) -> RunRow | None:
    """Return the run if it is finishing."""
    with reading(context.engine) as connection:
        run = runs.find(connection, run_id)
    return run if run is not None and run.state is RunState.FINISHING else None


@contextmanager
def _alone(context: Context, run_id: str) -> Iterator[bool]:
    """Hold the role of finishing a run during the body; give False if another process holds it."""
    seconds = context.settings.lease_seconds
    with writing(context.engine) as connection:
        now = database_time(connection)
        held = processes.hold_lease(connection, _role(run_id), owner=context.owner, now=now, seconds=seconds)
    if not held:
        yield False
        return

    def beat() -> None:
        try:
            with writing(context.engine) as connection:
                until = database_time(connection) + seconds
                processes.renew_lease(connection, _role(run_id), owner=context.owner, until=until)
        except TransientError as error:
            log.warning("finish.heartbeat", reason=str(error))

    try:
        with context.beating(context.settings.heartbeat_seconds, beat):
            yield True
    finally:
        with suppress(TransientError), writing(context.engine) as connection:  # else it expires
            processes.drop_lease(connection, _role(run_id), owner=context.owner)


def _role(run_id: str) -> str:
    return f"finish.{run_id}"


def _finish(context: Context, run: RunRow, write: Writer) -> bool:
    """Store the results and end the run, or pause it; return False if neither was possible."""
    with reading(context.engine) as connection:
        failures = results.failures(connection, run.id)

    def held(connection: Connection) -> bool:
        return processes.holds_lease(connection, _role(run.id), owner=context.owner)

    def require_held(connection: Connection) -> None:
        if not held(connection):
            raise _OvertakenError

    def keep(name: str, data: bytes) -> None:
        with writing(context.engine) as connection:
            require_held(connection)
        context.store.put(run_key(run.id, name), data, replace=True)

    try:
        write(context, run, failures, keep)
        remove_pictures(context, run, keep, require_held)
        state, reason = RunState.COMPLETED, None
        if failures:
            roots = [failure for failure in failures if isinstance(failure.error, Fault)]
            state = RunState.COMPLETED_WITH_FAILURES
            products = "product" if len(roots) == 1 else "products"
            reason = f"{len(roots)} {products} failed for good; see the report or `valerie status`"
    except (StorageFull, StorageUnavailable) as error:
        log.warning("finish.storage", run=run.id, error=str(error))
        pause_for_storage(context, error)
        return True
    except _OvertakenError:
        log.warning("finish.lease_lost", run=run.id)
        return False
    except TransientError as error:
        log.warning("finish.waits", run=run.id, error=str(error))
        return False
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _NO_ROOM:  # a library's temporary file
            log.warning("finish.storage", run=run.id, error=str(error))
            pause_for_storage(context, StorageFull(f"no space left for a temporary file: {error}"))
            return True
        # A defect must end the run too; otherwise it would be retried for ever.
        log.exception("finish.failed", run=run.id)
        state, reason = RunState.FAILED, f"the results could not be written: {error}"
    with writing(context.engine) as connection:
        if not held(connection):
            log.warning("finish.lease_lost", run=run.id)
            return False
        runs.change_state(
            connection,
            run.id,
            expected=(RunState.FINISHING,),
            state=state,
            reason=reason,
            finished_at=database_moment(connection),
        )
    log.info("run.finished", run=run.id, state=state)
    return True


def write_results(context: Context, run: RunRow, failures: Sequence[FailedLink], keep: Keep) -> None:
    """Keep table (Parquet, CSV), summary, report and environment."""
    run_results = read_results(context, run, failures)
    for name, write in ((TABLE_PARQUET, run_results.table.to_parquet), (TABLE_CSV, run_results.table.to_csv)):
        buffer = io.BytesIO()
        write(buffer)
        keep(name, buffer.getvalue())
    keep(SUMMARY, summary_json(run_results.analysis, run_results.verdicts))
    keep(REPORT, write_report(context, run_results).encode())
    keep(ENVIRONMENT, environment().model_dump_json().encode())


def summary_json(analysis: Analysis, verdicts: Sequence[RequirementVerdict]) -> bytes:
    """Return the numbers of a run as JSON."""
    return orjson.dumps(
        {
            "summary": asdict(analysis.summary),
            "findings": asdict(analysis.findings),
            "verdicts": list(map(asdict, verdicts)),
        },
        option=orjson.OPT_SERIALIZE_NUMPY,
    )
