"""Follow, cancel, resume, retry and delete runs."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Final

from sqlalchemy import Connection

from valerie.db import fed_blocks, products, retention, runs, usage
from valerie.db.engine import database_moment, database_time, reading, writing
from valerie.db.statements import lock
from valerie.errors import Conflict
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.deadlines import with_deadlines
from valerie.pipeline.base.sending import send_ready
from valerie.pipeline.control.quotas import CPU_PERIOD, limits_costs, require_quota, require_room, spent_by
from valerie.runs.products.progress import FrameProgress, ProgressToday, VariantProgress, outlook
from valerie.runs.products.states import ProductState, RunState
from valerie.storage.keys import run_prefix

#: States in which a run can be cancelled.
CANCELLABLE: Final = (RunState.SUBMITTED, RunState.RUNNING, RunState.PAUSED)
_RESUMABLE: Final = (RunState.PAUSED, RunState.CANCELLED)
_RETRYABLE: Final = (
    RunState.RUNNING,
    RunState.COMPLETED_WITH_FAILURES,
    RunState.PAUSED,
    RunState.CANCELLED,
    RunState.FAILED,
)
_UNFINISHED: Final = frozenset(ProductState) - {ProductState.DONE}


def progress(connection: Connection, run_id: str) -> ProgressToday:
    """Return the progress of a run: the latest count, with its present state and the outlook for its deadline.

    Raises:
        NotFound: no such run.
    """
    run = runs.get(connection, run_id)
    counted, expected = run.progress, None
    if run.deadline is not None:
        now = database_time(connection)
        expected = outlook(counted, run.state, run.deadline.timestamp() - now, now)
    return ProgressToday(
        state=run.state,
        reason=run.reason,
        variants=VariantProgress(total=run.variant_count, fed=run.next_index, rejected=run.rejected_count),
        frames=FrameProgress(fed=0, exact=False) if counted is None else counted.frames,
        stages={} if counted is None else counted.stages,
        awaiting=0 if counted is None else counted.awaiting,
        updated_at=None if counted is None else counted.updated_at,
        outlook=expected,
    )


def cancel(context: Context, run_id: str) -> None:
    """Stop a run. Its finished products stay; products that only this run needs are not computed.

    Raises:
        NotFound, Conflict: no such run, or it has ended.
    """
    with writing(context.engine) as connection:
        now = database_moment(connection)
        _change(connection, run_id, expected=CANCELLABLE, state=RunState.CANCELLED, finished_at=now)


def resume(context: Context, run_id: str) -> None:
    """Resume a paused or cancelled run with its parked products.

    Raises:
        NotFound, Conflict: no such run, or it is neither paused nor cancelled, or archived.
        QuotaExceeded: a quota of its owner or project has no room for it.
    """
    _restart(context, run_id, expected=_RESUMABLE, states=(ProductState.PARKED,))


def retry(context: Context, run_id: str) -> None:
    """Try the failed products of a run again.

    Raises:
        NotFound, Conflict: no such run, or its state allows no retry, or it is archived.
        QuotaExceeded: a quota of its owner or project has no room for it.
    """
    _restart(context, run_id, expected=_RETRYABLE, states=(ProductState.PARKED, ProductState.FAILED))


def delete(context: Context, run_id: str) -> None:
    """Delete an ended run; its products stay until `valerie.pipeline.control.gc` finds that nothing links to them.

    Raises:
        NotFound, Conflict: no such run, or it is still active (cancel it first).
    """
    seconds: float | None = None
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        since = database_time(connection) - CPU_PERIOD.total_seconds()
        if limits_costs(context.settings, run.owner, run.project):
            seconds = usage.unshared(connection, run, since=since).cpu_seconds
    with writing(context.engine) as connection:
        run = runs.get(connection, run_id)
        if run.state in runs.ACTIVE:
            raise Conflict(f"run {run_id} is {run.state}: cancel it before deleting it")
        if seconds is not None:
            usage.remember(connection, run, seconds, since=since)
        runs.remove(connection, run_id)
    context.store.delete(info.key for info in list(context.store.list(run_prefix(run_id).rstrip("/"))))


def _restart(context: Context, run_id: str, *, expected: Sequence[RunState], states: Sequence[ProductState]) -> None:
    # In one transaction: a running run with parked products would never end.
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        spent = spent_by(connection, context.settings, [(run.owner, run.project)])
    with writing(context.engine) as connection:
        now = database_time(connection)
        run = runs.to_change(connection, run_id)
        if run.state not in runs.ACTIVE:
            require_quota(connection, context.settings, run, spent)
        elif run.state is RunState.PAUSED:
            require_room(connection, context.settings, run, spent)
        pins = run.pins
        state = RunState.SUBMITTED if pins is None else RunState.RUNNING
        if pins is not None:
            runs.set_values(connection, run_id, pins=with_deadlines(pins, context.settings, now))
        _change(connection, run_id, expected=expected, state=state, finished_at=None)
        fed_blocks.reopen_blocks(connection, run_id)
        retention.keep_all(connection, run_id)
        # A worker may be parking some of them, as the run still seems to need nothing. Wait for it, and keep others out.
        lock(connection, runs.linked_digests(connection, run_id, _UNFINISHED))
        digests = runs.linked_digests(connection, run_id, states)
        products.revive(connection, digests)
        ready = products.promote(connection, digests, now)
    send_ready(context, ready)


def _change(
    connection: Connection,
    run_id: str,
    *,
    expected: Sequence[RunState],
    state: RunState,
    finished_at: datetime | None,
) -> None:
    present = runs.fed(connection, run_id).state
    if not runs.change_state(connection, run_id, expected=expected, state=state, finished_at=finished_at):
        allowed = ", ".join(expected)
        raise Conflict(f"run {run_id} is {present}; this is possible when it is {allowed}")
