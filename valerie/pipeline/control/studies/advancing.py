"""Advance studies: take outcomes, submit accepted batches, propose the next.

All state is in the database. Each step is one transaction, which does nothing if another process has done it. A proposal
depends only on the study and the stored outcomes, so a process that continues after a kill proposes the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from itertools import takewhile
from operator import attrgetter
from typing import Final, Unpack

import structlog

from valerie.db import runs, studies
from valerie.db.engine import database_moment, reading, writing
from valerie.db.runs import RunRow
from valerie.db.studies import BatchRow, StudyRow, StudyValues
from valerie.errors import QuotaExceeded, TransientError, ValerieError
from valerie.parameters.assignment import digest
from valerie.parameters.samplers import UnitPoints
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.quotas import limits_costs
from valerie.pipeline.control.studies.resolving import resolve_row
from valerie.pipeline.control.submit import submit
from valerie.pipeline.reading.selection import evaluated_persons
from valerie.runs.moments import moment_text
from valerie.runs.products.states import RunState
from valerie.runs.study.study_document import StudyState
from valerie.studies.pursuit import LAG, Pursuit
from valerie.studies.reasons import reason_text
from valerie.studies.resolved import ResolvedStudy

log = structlog.get_logger()

#: Retries of a run with failed products before the study pauses.
RETRIES: Final = 3
#: Pause after a run was refused whose forecast had to be computed.
_REFUSED_SECONDS: Final = 30.0
#: Proposed variants for each of the budget, at which a strategy that proposes rejected ones is ended: they cost nothing.
MOST_PROPOSED: Final = 20


class StudyKeeper:
    """Advances the studies of a deployment. Its state is a cache, recomputed from the stored batches."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._pursuits: dict[str, Pursuit] = {}
        self._refused: dict[str, float] = {}

    def advance(self) -> None:
        """Advance every running study as far as possible."""
        with reading(self._context.engine) as connection:
            rows = studies.running(connection)
        for study in rows:
            try:
                while self._step(study):
                    pass
            except TransientError:
                raise
            except Exception as error:
                # A defective strategy must not hold up other studies or the runs.
                reason = str(error) if isinstance(error, ValerieError) else f"a defect of the strategy: {error!r}"
                log.warning("study.paused", study=study.id, reason=reason, exc_info=not isinstance(error, ValerieError))
                self._pursuits.pop(study.id, None)
                self._change(study, state=StudyState.PAUSED, reason=reason)
        self._pursuits = {row.id: self._pursuits[row.id] for row in rows if row.id in self._pursuits}

    def _step(self, study: StudyRow) -> bool:
        """Advance a study by one step; return True if another step may follow at once."""
        with reading(self._context.engine) as connection:
            batches = studies.batches(connection, study.id)
            study = studies.get(connection, study.id)
        if study.state is not StudyState.RUNNING:
            return False
        for batch in batches:
            if batch.ended or batch.accepted_at is None:
                continue
            if batch.run_id is None:
                return self._submit(study, batches, batch)
            if self._end(study, batch):
                return True
        return self._propose(study, batches)

    # -- runs ------------------------------------------------------------------------------------------------------------

    def _submit(self, study: StudyRow, batches: Sequence[BatchRow], batch: BatchRow) -> bool:
        """Start the run of an accepted batch; return False if it must wait for room in a quota.

        The idempotency key finds a run that a killed process has started.
        """
        if self._context.elapsed() < self._refused.get(study.id, 0.0):
            return False
        pursuit = self._pursuit(study, batches)
        spec = pursuit.spec(batch.number, parent=parent_of(batches, batch.number))
        key = f"study/{study.id}/{batch.number}"
        try:
            run_id = submit(
                self._context,
                spec,
                idempotency_key=key,
                deadline=study.document.budget.deadline,
                owner=study.owner,
                project=study.project,
            )
        except QuotaExceeded as error:
            if limits_costs(self._context.settings, study.owner, study.project):
                self._refused[study.id] = self._context.elapsed() + _REFUSED_SECONDS
            if study.reason != str(error):
                self._change(study, reason=str(error))
            return False
        with writing(self._context.engine) as connection:
            studies.set_run(connection, study.id, batch.number, run_id)
            studies.set_values(connection, study.id, expected=StudyState.RUNNING, reason=None)
        log.info("study.batch", study=study.id, batch=batch.number, run=run_id)
        return True

    def _end(self, study: StudyRow, batch: BatchRow) -> bool:
        """Store the outcomes of a batch if its run has ended; return True if it has."""
        assert batch.run_id is not None, "a submitted batch"
        with reading(self._context.engine) as connection:
            run = runs.find(connection, batch.run_id)
        if run is None or run.state in (RunState.CANCELLED, RunState.FAILED):
            ending = "was deleted" if run is None else f"is {run.state}" + (f": {run.reason}" if run.reason else "")
            self._change(
                study, state=StudyState.PAUSED, reason=f"run {batch.run_id} of batch {batch.number + 1} {ending}"
            )
            return False
        if run.state is RunState.COMPLETED_WITH_FAILURES:
            self._retry(study, batch, run)
            return False
        if run.state is not RunState.COMPLETED:
            return False
        resolved = self._pursuit_study(study)
        stored = resolve_stored(run, self._context.settings)
        with reading(self._context.engine) as connection:
            rows = (person.row for person in evaluated_persons(connection, stored))
            price = studies.cpu_seconds(connection, run.id)
            outcomes = resolved.outcomes(rows, len(batch.points), batch.rejected, price)
        with writing(self._context.engine) as connection:
            studies.end(connection, study.id, batch.number, outcomes)
        return True

    def _retry(self, study: StudyRow, batch: BatchRow, run: RunRow) -> None:
        """Retry failed products, since a variant with a failed product has no outcome."""
        if batch.retries >= RETRIES:
            reason = f"run {run.id} of batch {batch.number + 1}: {run.reason}"
            self._change(study, state=StudyState.PAUSED, reason=f"{reason} (retried {RETRIES} times)")
            return
        with writing(self._context.engine) as connection:
            if not studies.count_retry(connection, study.id, batch.number, batch.retries):
                return
        lifecycle.retry(self._context, run.id)

    # -- proposals -------------------------------------------------------------------------------------------------------

    def _propose(self, study: StudyRow, batches: Sequence[BatchRow]) -> bool:
        number = len(batches)
        basis = batches[: max(number - LAG + 1, 0)]
        if not all(batch.ended for batch in basis) or (batches and batches[-1].accepted_at is None):
            return False
        pursuit = self._pursuit(study, batches)
        pursuit.tell_due(batches)
        ended = self._over_budget(study, batches, basis) or pursuit.enough()
        if ended is None:
            count = min(study.document.batch, left(study, batches))
            proposal = pursuit.ask(batches, count)
            reason = reason_text(proposal.reason, pursuit.study.domain.names)
            if len(proposal) or pursuit.waits:
                self._store(study, pursuit.study, basis, number, count, proposal.points, reason)
                return True
            self._pursuits.pop(study.id)
            ended = reason
        if not all(batch.ended for batch in batches):
            return False  # the last batch is still in work, and is part of the result
        result = informed_pursuit(pursuit.study, batches).result()
        self._change(study, state=StudyState.FINISHED, reason=ended, result=result, finished_at=self._now())
        log.info("study.finished", study=study.id, reason=ended)
        return False

    def _store(
        self,
        study: StudyRow,
        resolved: ResolvedStudy,
        basis: Sequence[BatchRow],
        number: int,
        count: int,
        points: UnitPoints,
        reason: str,
    ) -> None:
        now = self._now()
        batch = BatchRow(
            study_id=study.id,
            number=number,
            count=count,
            points=points.tolist(),
            rejected=[i for i, legal in enumerate(resolved.domain.legal(points)) if not legal],
            reason=reason,
            basis=basis_digest(study, basis),
            based_on=len(basis),
            accepted_at=None if study.by_hand and len(points) else now,
        )
        result = self._pursuits[study.id].result()
        with writing(self._context.engine) as connection:
            studies.propose(connection, batch)
            waits = f"batch {number + 1} is proposed: accept it" if batch.accepted_at is None else None
            studies.set_values(connection, study.id, expected=StudyState.RUNNING, reason=waits, result=result)

    def _over_budget(self, study: StudyRow, batches: Sequence[BatchRow], basis: Sequence[BatchRow]) -> str | None:
        """Return the reason why the budget is spent; None while it is not."""
        budget = study.document.budget
        if left(study, batches) == 0:
            return f"the budget of {budget.variants:,} variants is spent"
        proposed = sum(len(batch.points) for batch in batches)
        if proposed >= MOST_PROPOSED * budget.variants:
            return f"of {proposed:,} proposed variants, {sum(len(batch.rejected) for batch in batches):,} are rejected"
        hours = sum(batch.cpu_seconds or 0.0 for batch in basis) / 3600
        if budget.cpu_hours is not None and hours >= budget.cpu_hours:
            return f"the budget of {budget.cpu_hours:g} CPU hours is spent"
        if budget.deadline is not None and self._now() >= budget.deadline:
            return f"the deadline has passed: {moment_text(budget.deadline)}"
        return None

    def _now(self) -> datetime:
        with reading(self._context.engine) as connection:
            return database_moment(connection)

    # -- the study -------------------------------------------------------------------------------------------------------

    def _pursuit(self, study: StudyRow, batches: Sequence[BatchRow]) -> Pursuit:
        pursuit = self._pursuits.get(study.id)
        if pursuit is None or not pursuit.agrees(batches):
            pursuit = self._pursuits[study.id] = Pursuit(resolve_row(self._context, study))
        pursuit.follow(batches)
        return pursuit

    def _pursuit_study(self, study: StudyRow) -> ResolvedStudy:
        pursuit = self._pursuits.get(study.id)
        return resolve_row(self._context, study) if pursuit is None else pursuit.study

    def _change(self, study: StudyRow, **values: Unpack[StudyValues]) -> None:
        with writing(self._context.engine) as connection:
            studies.set_values(connection, study.id, expected=StudyState.RUNNING, **values)


def informed_pursuit(resolved: ResolvedStudy, batches: Sequence[BatchRow]) -> Pursuit:
    """Return a pursuit that has been told every batch before the first unfinished one."""
    pursuit = Pursuit(resolved)
    pursuit.follow([*takewhile(attrgetter("ended"), batches)], everything=True)
    return pursuit


def parent_of(batches: Sequence[BatchRow], number: int) -> str | None:
    """Return the id of the run before that of a batch; None for the first run."""
    return next((batch.run_id for batch in reversed(batches[:number]) if batch.run_id is not None), None)


def left(study: StudyRow, batches: Sequence[BatchRow]) -> int:
    """Return the number of variants left in the budget; rejected ones do not count."""
    return max(study.document.budget.variants - sum(batch.legal for batch in batches), 0)


def basis_digest(study: StudyRow, basis: Sequence[BatchRow]) -> str:
    """Return the digest of everything that a proposal depends on."""
    outcomes = [
        None if batch.outcomes is None else batch.outcomes.model_dump(mode="json", exclude_none=True) for batch in basis
    ]
    return digest("study-basis", [study.document.digest, outcomes])
