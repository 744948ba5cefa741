"""Queries about webhooks: which receivers have heard of which ended runs."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Final

from sqlalchemy import ColumnElement, Connection, and_, func, insert, select, update

from valerie.db.models import Delivery, Run
from valerie.db.rows import columns_of, read_all
from valerie.runs.products.states import RunState

_FINAL: Final = tuple(state for state in RunState if state.is_final)


@dataclass(frozen=True, slots=True)
class RunEnding:
    """A run that ended, and how often a receiver was told so in vain. A resumed run ends again."""

    id: str
    name: str
    state: RunState
    reason: str | None
    owner: str | None
    finished_at: datetime
    attempts: int


def due(connection: Connection, receiver: str, *, since: datetime, now: float, limit: int) -> list[RunEnding]:
    """Return the endings that a receiver has not heard of and may be told now, oldest first.

    Args:
        receiver: see `valerie.db.models.Delivery`.
        since: earlier endings are left out.
        now: of `valerie.db.engine.database_time`.
        limit: most endings.
    """
    query = (
        select(*columns_of(RunEnding, Run, attempts=func.coalesce(Delivery.attempts, 0)))
        .outerjoin(Delivery, _of(receiver))
        .where(Run.state.in_(_FINAL), Run.finished_at >= since)
        .where(Delivery.run_id.is_(None) | (Delivery.due_at <= now))
        .order_by(Run.finished_at, Run.id)
        .limit(limit)
    )
    return read_all(connection, query, RunEnding)


def note(
    connection: Connection, ending: RunEnding, receiver: str, *, due_at: float | None, problem: str | None = None
) -> None:
    """Record an attempt to tell a receiver of an ending; nothing if the run was deleted meanwhile.

    Args:
        due_at: time of the next attempt, Unix seconds; None: the receiver has heard of it.
        problem: why it has not.
    """
    # The lock keeps the run from being deleted before the row is written.
    if connection.scalar(select(Run.id).where(Run.id == ending.id).with_for_update()) is None:
        return
    key = {"run_id": ending.id, "ended_at": ending.finished_at, "receiver": receiver}
    values = {"attempts": ending.attempts + 1, "due_at": due_at, "problem": problem}
    if connection.execute(update(Delivery).filter_by(**key).values(**values)).rowcount == 0:
        connection.execute(insert(Delivery).values(**key, **values))


def problems(connection: Connection, receiver: str, *, since: datetime) -> list[str]:
    """Return why a receiver has not heard of endings since a moment, latest first."""
    query = select(Delivery.problem).join(Run, _of(receiver))
    latest = query.where(Run.finished_at >= since, Delivery.problem.is_not(None)).order_by(Run.finished_at.desc())
    return [str(problem) for problem in connection.scalars(latest)]


def _of(receiver: str) -> ColumnElement[bool]:
    return and_(Delivery.run_id == Run.id, Delivery.ended_at == Run.finished_at, Delivery.receiver == receiver)
