"""What a user may do with a run after submitting it: follow, cancel, resume, retry, delete."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import structlog
from sqlalchemy import Connection

from valerie.db import products, runs
from valerie.db.engine import writing
from valerie.errors import Conflict, TransientError
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.deadlines import with_deadlines
from valerie.runs.states import RunState
from valerie.storage.keys import run_prefix

log = structlog.get_logger()

_RESUMABLE = (RunState.PAUSED, RunState.CANCELLED)
_RETRYABLE = (
    RunState.RUNNING,
    RunState.COMPLETED_WITH_FAILURES,
    RunState.PAUSED,
    RunState.CANCELLED,
    RunState.FAILED,
)


def progress(connection: Connection, run_id: str) -> dict[str, Any]:
    """The latest progress document, with the state of this moment.

    Raises:
        NotFound: no such run.
    """
    run = runs.get(connection, run_id)
    counted = run.progress or {"stages": {}, "updated_at": None}
    return {
        **counted,
        "state": run.state,
        "reason": run.reason,
        "variants": {"total": run.variant_count, "fed": run.next_index, "rejected": run.rejected_count},
    }


def cancel(context: Context, run_id: str) -> None:
    """Stop a run. What is done stays; what only this run wanted is not computed.

    Raises:
        NotFound, Conflict: no such run, or it has ended.
    """
    expected = (RunState.SUBMITTED, RunState.RUNNING, RunState.PAUSED)
    with writing(context.engine) as connection:
        _change(connection, run_id, expected=expected, state=RunState.CANCELLED, finished_at=runs.now_utc())


def resume(context: Context, run_id: str) -> None:
    """Let a paused or cancelled run go on; what nobody linked meanwhile is wanted again.

    Raises:
        NotFound, Conflict: no such run, or it is neither paused nor cancelled.
    """
    _restart(context, run_id, expected=_RESUMABLE, states=("parked",))


def retry(context: Context, run_id: str) -> None:
    """Try again what failed for good in a run.

    Raises:
        NotFound, Conflict: no such run, or nothing of it failed.
    """
    _restart(context, run_id, expected=_RETRYABLE, states=("parked", "failed"))


def delete(context: Context, run_id: str) -> None:
    """Remove an ended run; its products stay until `valerie.pipeline.control.gc` finds that nobody links them.

    Raises:
        NotFound, Conflict: no such run, or it is still active (cancel it first).
    """
    with writing(context.engine) as connection:
        run = runs.get(connection, run_id)
        if run.state in runs.ACTIVE:
            raise Conflict(f"run {run_id} is {run.state}: cancel it before deleting it")
        runs.remove(connection, run_id)
    context.store.delete(info.key for info in list(context.store.list(run_prefix(run_id).rstrip("/"))))


def _restart(context: Context, run_id: str, *, expected: Sequence[RunState], states: Sequence[str]) -> None:
    # In one transaction: a run that is running again while its products stay parked would never end.
    with writing(context.engine) as connection:
        pins = runs.get(connection, run_id).pins
        state = RunState.SUBMITTED if pins is None else RunState.RUNNING
        if pins is not None:
            runs.set_values(connection, run_id, pins=with_deadlines(pins, context.settings, time.time()))
        _change(connection, run_id, expected=expected, state=state, finished_at=None)
        runs.reopen_blocks(connection, run_id)
        digests = runs.linked_digests(connection, run_id, states)
        products.revive(connection, digests)
        ready = products.promote(connection, digests, time.time())
    try:
        context.broker.send_products(ready)
    except TransientError as error:
        log.warning("lifecycle.broker", reason=str(error))  # the sweeper rings again


def _change(
    connection: Connection, run_id: str, *, expected: Sequence[RunState], state: RunState, **values: Any
) -> None:
    run = runs.get(connection, run_id)
    if not runs.change_state(connection, run_id, expected=expected, state=state, **values):
        allowed = ", ".join(expected)
        raise Conflict(f"run {run_id} is {run.state}; this is possible when it is {allowed}")
