"""Commands on studies: plan, begin, show and accept the next batch, change the mode, stop, resume."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from valerie.db import runs, studies
from valerie.db.engine import database_moment, reading, writing
from valerie.db.studies import BatchRow, StudyRow
from valerie.errors import Conflict, InvalidInput
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.control.quotas import require_possible_batch
from valerie.pipeline.control.studies.advancing import basis_digest, informed_pursuit, left, parent_of
from valerie.pipeline.control.studies.resolving import resolve_document, resolve_row
from valerie.pipeline.control.submit import new_id
from valerie.runs.forecasting.plan import Plan
from valerie.runs.moments import moment_text
from valerie.runs.products.states import RunState
from valerie.runs.study.study_document import StudyDocument, StudyState
from valerie.studies.pursuit import Pursuit
from valerie.studies.reasons import reason_text


@dataclass(frozen=True, slots=True)
class NextBatch:
    """The next batch of a study with its cost.

    Attributes:
        number: number of the batch, from 0.
        reason: reason for these variants.
        legal, rejected: numbers of variants.
        accepted: False while it waits for a person.
        run_id: id of its run; None before it starts.
        spec: spec of its run, as YAML.
        plan: size and cost of its run.
    """

    number: int
    reason: str
    legal: int
    rejected: int
    accepted: bool
    run_id: str | None
    spec: str
    plan: Plan


def plan_study(context: Context, document: StudyDocument, *, project: str = "") -> NextBatch:
    """Return the first batch of a study of a project without storing anything.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    _require_time(context, document)
    pursuit = Pursuit(resolve_document(context, document))
    proposal = pursuit.ask((), document.batch)
    legal = int(np.count_nonzero(pursuit.study.domain.legal(proposal.points)))
    spec = pursuit.spec(0, parent=None)
    return NextBatch(
        number=0,
        reason=reason_text(proposal.reason, pursuit.study.domain.names),
        legal=legal,
        rejected=len(proposal) - legal,
        accepted=False,
        run_id=None,
        spec=spec.to_yaml(),
        plan=plan_run(context, spec, project=project, notes=pursuit.study.run.notes),
    )


def begin(context: Context, document: StudyDocument, *, owner: str | None = None, project: str = "") -> str:
    """Store a study and return its id; the control loop advances it.

    Args:
        context: context of the deployment.
        document: what the study asks.
        owner: owner of the token that begins it; None: the operator.
        project: of that token; empty: none.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
    """
    require_possible_batch(context.settings, owner, project, document.batch)
    now = _require_time(context, document)
    resolved = resolve_document(context, document)
    Pursuit(resolved).ask((), document.batch)  # refuses a domain without legal variants, and a budget too small
    study = StudyRow(
        id=new_id("s", now.timestamp()),
        name=document.name,
        state=StudyState.RUNNING,
        reason=None,
        document=document,
        asset_digest=resolved.run.asset_digest,
        by_hand=document.mode == "by hand",
        result=None,
        owner=owner,
        project=project,
        created_at=now,
        finished_at=None,
    )
    with writing(context.engine) as connection:
        studies.create(connection, study)
    return study.id


def _require_time(context: Context, document: StudyDocument) -> datetime:
    """Return the present moment; refuse a study whose deadline has passed, since it would propose nothing."""
    with reading(context.engine) as connection:
        now = database_moment(connection)
    deadline = document.budget.deadline
    if deadline is not None and deadline <= now:
        raise InvalidInput(
            "the deadline has passed",
            field="budget.deadline",
            value=moment_text(deadline),
            limit=f"a moment after {moment_text(now)}",
        )
    return now


def next_batch(context: Context, study_id: str) -> NextBatch:
    """Return the newest batch that has not ended, with its reason and cost.

    Raises:
        NotFound: no such study.
        Conflict: no batch is open.
    """
    study, batches = _read(context, study_id)
    batch = next((batch for batch in reversed(batches) if not batch.ended), None)
    if batch is None:
        waits = "it proposes the next one soon" if study.state is StudyState.RUNNING else study.reason
        raise Conflict(f"no batch of study {study_id} is open: it is {study.state}, {waits}")
    pursuit = Pursuit(resolve_row(context, study))
    pursuit.follow(batches)
    spec = pursuit.spec(batch.number, parent=parent_of(batches, batch.number))
    return NextBatch(
        number=batch.number,
        reason=batch.reason,
        legal=batch.legal,
        rejected=len(batch.rejected),
        accepted=batch.accepted_at is not None,
        run_id=batch.run_id,
        spec=spec.to_yaml(),
        plan=plan_run(context, spec, notes=pursuit.study.run.notes),
    )


def accept(context: Context, study_id: str, *, count: int | None = None) -> int:
    """Accept the proposed batch and return its number.

    Only the size of a batch can be edited: points picked by a person have no density and would bias the estimate. A person's
    own variants belong in an ordinary run, for which `next_batch` returns a spec.

    Args:
        context: context of the deployment.
        study_id: id of a running study.
        count: another number of points, for which the strategy makes a new proposal.

    Raises:
        NotFound: no such study.
        Conflict: no proposal waits.
        InvalidInput: ``count`` is out of bounds, or a stop rule fixes the sizes of batches.
    """
    study, batches = _read(context, study_id)
    if study.state is not StudyState.RUNNING or not batches or batches[-1].accepted_at is not None:
        raise Conflict(f"no proposal of study {study_id} waits: the study is {study.state}")
    batch, earlier = batches[-1], batches[:-1]
    with writing(context.engine) as connection:
        if count is not None and count != batch.count:
            if study.document.stop.width is not None:
                raise InvalidInput(
                    "the stop rule shares the error among looks that were planned, so batches keep their size",
                    field="count",
                    value=count,
                    limit=batch.count,
                )
            limit = left(study, earlier)
            if not 1 <= count <= min(limit, 1000):
                raise InvalidInput("out of bounds", field="count", value=count, limit=f"1 … {min(limit, 1000)}")
            studies.replace_proposal(connection, _resized(context, study, earlier, batch, count))
        studies.accept(connection, study_id, batch.number, database_moment(connection))
        studies.set_values(connection, study_id, expected=StudyState.RUNNING, reason=None)
    return batch.number


def set_mode(context: Context, study_id: str, *, by_hand: bool) -> None:
    """Let a person accept each batch, or accept them automatically, a waiting proposal at once.

    Raises:
        NotFound, Conflict: no such study, or it has ended.
    """
    study, batches = _read(context, study_id)
    _require_going(study)
    with writing(context.engine) as connection:
        studies.set_values(connection, study_id, expected=study.state, by_hand=by_hand)
        if not by_hand and batches and batches[-1].accepted_at is None:
            studies.accept(connection, study_id, batches[-1].number, database_moment(connection))
            studies.set_values(connection, study_id, expected=StudyState.RUNNING, reason=None)


def stop(context: Context, study_id: str) -> None:
    """End a study now: cancel its runs, and store the result from the batches that ended.

    Raises:
        NotFound, Conflict: no such study, or it has ended.
    """
    study, batches = _read(context, study_id)
    _require_going(study)
    result = informed_pursuit(resolve_row(context, study), batches).result()
    with writing(context.engine) as connection:
        studies.set_values(
            connection,
            study_id,
            expected=study.state,
            state=StudyState.STOPPED,
            reason="stopped by hand",
            result=result,
            finished_at=database_moment(connection),
        )
    for run_id in _open_runs(batches):
        if _state(context, run_id) in lifecycle.CANCELLABLE:
            lifecycle.cancel(context, run_id)


def resume(context: Context, study_id: str) -> None:
    """Resume a paused study and its runs, and retry failed products.

    Raises:
        NotFound, Conflict: no such study, or it is not paused.
    """
    study, batches = _read(context, study_id)
    if study.state is not StudyState.PAUSED:
        raise Conflict(f"study {study_id} is {study.state}; this is possible when it is paused")
    for run_id in _open_runs(batches):
        state = _state(context, run_id)
        if state is RunState.CANCELLED:
            lifecycle.resume(context, run_id)
        elif state in (RunState.FAILED, RunState.COMPLETED_WITH_FAILURES):
            lifecycle.retry(context, run_id)
    with writing(context.engine) as connection:
        studies.reset_retries(connection, study_id)
        studies.set_values(connection, study_id, expected=StudyState.PAUSED, state=StudyState.RUNNING, reason=None)


def _resized(context: Context, study: StudyRow, earlier: list[BatchRow], batch: BatchRow, count: int) -> BatchRow:
    pursuit = Pursuit(resolve_row(context, study))
    pursuit.follow(earlier)
    proposal = pursuit.ask(earlier, count)
    legal = pursuit.study.domain.legal(proposal.points)
    return replace(
        batch,
        count=count,
        points=proposal.points.tolist(),
        rejected=np.flatnonzero(~legal).tolist(),
        reason=reason_text(proposal.reason, pursuit.study.domain.names),
        basis=basis_digest(study, earlier[: batch.based_on]),
    )


def _read(context: Context, study_id: str) -> tuple[StudyRow, list[BatchRow]]:
    with reading(context.engine) as connection:
        return studies.get(connection, study_id), studies.batches(connection, study_id)


def _require_going(study: StudyRow) -> None:
    if study.state.is_final:
        raise Conflict(f"study {study.id} is {study.state}; this is possible only before it ends")


def _open_runs(batches: list[BatchRow]) -> list[str]:
    return [batch.run_id for batch in batches if batch.run_id is not None and not batch.ended]


def _state(context: Context, run_id: str) -> RunState | None:
    with reading(context.engine) as connection:
        run = runs.find(connection, run_id)
    return None if run is None else run.state
