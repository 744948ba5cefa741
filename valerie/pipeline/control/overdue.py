"""Fails predictions that were not uploaded before their deadline."""

from __future__ import annotations

from collections.abc import Sequence

from valerie.db import products, runs
from valerie.db.engine import reading, writing
from valerie.db.runs import RunRow
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.deadlines import deadlines, until
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind


def fail_overdue(context: Context, running: Sequence[RunRow], now: float) -> None:
    """Fail predictions whose deadline has passed, unless another run still waits for them."""
    overdue: dict[str, str] = {}
    awaited: set[str] = set()
    for run in running:
        for name, deadline in deadlines(run.pins).items():
            with reading(context.engine) as connection:
                missing = runs.awaited(connection, run.id, run.spec.functions.index(name))
            if deadline > now:
                awaited.update(missing)
            else:
                overdue.update(dict.fromkeys(missing, f"no prediction by {until(deadline)}"))
    late = [digest for digest in overdue if digest not in awaited]
    if late:
        with writing(context.engine) as connection:
            products.lock_with_dependents(connection, late)
            for digest in late:
                error = Fault(stage=ProductKind.PREDICTION, type="NoPrediction", message=overdue[digest], attempts=0)
                products.fail(connection, digest, owner=None, error=error, now=now)
