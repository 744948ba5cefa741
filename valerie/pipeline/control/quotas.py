"""Quotas: how much the tokens of one owner, or of one project, may have unfinished, compute and store."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import timedelta
from enum import StrEnum
from typing import Final

from sqlalchemy import Connection

from valerie.db import tokens, usage
from valerie.db.engine import database_time
from valerie.db.runs import RunRow, SubmittedRun
from valerie.errors import InvalidInput, QuotaExceeded
from valerie.runs.forecasting.costs import Cost
from valerie.settings import Settings

#: Products made within this time count for the quota of CPU hours.
CPU_PERIOD: Final = timedelta(days=30)


class Resource(StrEnum):
    """What a quota limits."""

    RUNS = "runs"
    VARIANTS = "variants"
    CPU_HOURS = "cpu-hours"
    GIGABYTES = "gigabytes"


#: What a run's forecast counts for.
_COSTS: Final = frozenset((Resource.CPU_HOURS, Resource.GIGABYTES))


@dataclass(frozen=True, slots=True)
class Quota:
    """One quota of an owner or a project, and what counts for it.

    Attributes:
        holder: the owner, or ``project NAME``.
        resource: what is limited.
        used: unfinished runs, their variants, CPU hours of 30 days, or gigabytes stored.
        forecast: CPU hours or gigabytes that unfinished runs are yet to take.
        limit: of both together.
    """

    holder: str
    resource: Resource
    used: float
    forecast: float
    limit: float

    @property
    def exhaustion(self) -> str | None:
        """The reason, in words, why no run may go on; None if there is room."""
        if self.used < self.limit:
            return None
        if self.resource is Resource.CPU_HOURS:
            took = f"took {_number(self.used)} CPU hours in {CPU_PERIOD.days} days"
            return f"runs of {self.holder} {took}; limit: {self.limit:g}"
        if self.resource is Resource.GIGABYTES:
            return (
                f"runs of {self.holder} store {_number(self.used)} GB; limit: {self.limit:g}; delete runs to make room"
            )
        return None  # a run that has begun is counted

    def refusal(self, more: float) -> str | None:
        """Return the reason, in words, why a run that takes ``more`` may not start; None if it may."""
        total = self.used + self.forecast + more
        if self.exhaustion is not None or total <= self.limit:
            return self.exhaustion
        if self.resource not in _COSTS:
            what = "unfinished runs" if self.resource is Resource.RUNS else "variants in unfinished runs"
            return f"{self.holder} would have {total:,.0f} {what}; limit: {self.limit:,.0f}"
        if self.resource is Resource.CPU_HOURS:
            would, done = f"take {_number(total)} CPU hours in {CPU_PERIOD.days} days", "taken"
        else:
            would, done = f"store {_number(total)} GB", "stored"
        parts = f"{_number(self.used)} {done}, {_number(self.forecast)} forecast for unfinished runs"
        return f"runs of {self.holder} would {would}: {parts}, {_number(more)} for this one; limit: {self.limit:g}"


@dataclass(frozen=True, slots=True)
class _Holder:
    """An owner or a project."""

    owner: str | None
    project: str

    @property
    def name(self) -> str:
        return f"project {self.project}" if self.owner is None else self.owner

    def limits(self, settings: Settings) -> Mapping[Resource, float]:
        """Return the quotas that are set."""
        kind = "project" if self.owner is None else "owner"
        limits = {resource: getattr(settings, f"max_{kind}_{resource.name.lower()}") for resource in Resource}
        return {resource: limit for resource, limit in limits.items() if limit}

    def quotas(self, connection: Connection, settings: Settings, spent: Spent, *, besides: str = "") -> list[Quota]:
        """Return the quotas that are set, with what counts; ``besides`` is a run that does not count as unfinished."""
        limits = self.limits(settings)
        if not limits:
            return []
        unfinished = usage.unfinished(connection, owner=self.owner, project=self.project, besides=besides)
        used = _amounts(unfinished.runs, unfinished.variants, spent.get(self, Cost(0.0, 0.0)))
        forecast = _amounts(0, 0, unfinished.forecast)
        return [Quota(self.name, each, used[each], forecast[each], limit) for each, limit in limits.items()]


#: What owners and projects with quotas of CPU hours or bytes took.
Spent = Mapping[_Holder, Cost]
#: An owner and a project.
Pair = tuple[str | None, str]


def spent_by(connection: Connection, settings: Settings, pairs: Iterable[Pair]) -> Spent:
    """Add up what owners and projects took; of millions of products, that takes seconds, so not while others wait."""
    since = database_time(connection) - CPU_PERIOD.total_seconds()
    holders = {holder for pair in pairs for holder in _holders(*pair) if _COSTS & holder.limits(settings).keys()}
    return {each: usage.made(connection, owner=each.owner, project=each.project, since=since) for each in holders}


def require_quota(connection: Connection, settings: Settings, run: SubmittedRun, spent: Spent) -> None:
    """Refuse another run that would exceed a quota of its owner or its project.

    Their tokens are locked until the transaction ends, so that two requests cannot share the last room. The operator's runs
    have no quotas.

    Args:
        connection: of the transaction that starts the run.
        settings: of this deployment.
        run: the run.
        spent: of its owner and its project.

    Raises:
        QuotaExceeded: with the quota, the value and the limit.
    """
    holders = [holder for holder in _holders(run.owner, run.project) if holder.limits(settings)]
    if holders:
        tokens.lock(connection, owner=run.owner, project=run.project)
    rest = usage.rest(run.forecast, run.progress if isinstance(run, RunRow) else None)
    for holder in holders:
        for reason in _refusals(holder.quotas(connection, settings, spent, besides=run.id), run.variant_count, rest):
            raise QuotaExceeded(reason)


def require_room(connection: Connection, settings: Settings, run: SubmittedRun, spent: Spent) -> None:
    """Refuse to go on with a run whose owner or project has used up CPU hours or bytes.

    Raises:
        QuotaExceeded: with the quota, the value and the limit.
    """
    for reason in exhausted(connection, settings, [run], spent).values():
        raise QuotaExceeded(reason)


def exhausted(connection: Connection, settings: Settings, some: Iterable[SubmittedRun], spent: Spent) -> dict[str, str]:
    """Return those of some runs, by id, whose owner or project has used up CPU hours or bytes, with the reason."""
    reasons: dict[_Holder, str] = {}
    for holder in spent:
        for quota in holder.quotas(connection, settings, spent):
            if quota.exhaustion is not None:
                reasons[holder] = quota.exhaustion
    found = ((run.id, reasons.get(holder)) for run in some for holder in _holders(run.owner, run.project))
    return {run_id: reason for run_id, reason in found if reason is not None}


def refusals(
    connection: Connection, settings: Settings, variants: int, forecast: Cost, *, owner: str | None, project: str
) -> list[str]:
    """Return why a run of so many variants and costs would be refused now, in words."""
    spent = spent_by(connection, settings, [(owner, project)])
    quotas = (holder.quotas(connection, settings, spent) for holder in _holders(owner, project))
    return [reason for each in quotas for reason in _refusals(each, variants, forecast)]


def limits_costs(settings: Settings, owner: str | None, project: str) -> bool:
    """Return True if the owner or the project has a quota of CPU hours or bytes, so that runs need a forecast."""
    return any(_COSTS & holder.limits(settings).keys() for holder in _holders(owner, project))


def quotas_of(connection: Connection, settings: Settings, owner: str | None, project: str) -> list[Quota]:
    """Return the quotas of an owner and a project; for the operator those of all that have runs."""
    pairs: list[Pair] = [*usage.holders(connection)] if owner is None else [(owner, project)]
    spent = spent_by(connection, settings, pairs)
    holders = dict.fromkeys(holder for pair in pairs for holder in _holders(*pair))
    return [quota for holder in holders for quota in holder.quotas(connection, settings, spent)]


def require_possible_batch(settings: Settings, owner: str | None, project: str, batch: int) -> None:
    """Refuse a study whose batches would wait for ever, since each alone exceeds a quota.

    Args:
        settings: of this deployment.
        owner, project: of the study.
        batch: variants of a batch.

    Raises:
        InvalidInput: with the size and the quota.
    """
    for holder in _holders(owner, project):
        limit = holder.limits(settings).get(Resource.VARIANTS)
        if limit is not None and batch > limit:
            raise InvalidInput(
                f"a batch is larger than all that {holder.name} may have unfinished",
                field="batch",
                value=batch,
                limit=f"{limit:,} variants (VALERIE_MAX_{'PROJECT' if holder.owner is None else 'OWNER'}_VARIANTS)",
            )


def _refusals(quotas: Iterable[Quota], variants: int, forecast: Cost) -> Iterator[str]:
    more = _amounts(1, variants, forecast)
    return filter(None, (quota.refusal(more[quota.resource]) for quota in quotas))


def _amounts(runs: int, variants: int, cost: Cost) -> dict[Resource, float]:
    """Return what runs take, in the units of the quotas."""
    return {
        Resource.RUNS: runs,
        Resource.VARIANTS: variants,
        Resource.CPU_HOURS: cost.cpu_seconds / 3600,
        Resource.GIGABYTES: cost.bytes / 1e9,
    }


def _number(value: float) -> str:
    return f"{value:,.2f}" if value >= 1 else f"{value:.2g}"


def _holders(owner: str | None, project: str) -> Iterator[_Holder]:
    """Yield the owner and the project of a run; none of an operator's run."""
    if owner is not None:
        yield _Holder(owner, "")
        if project:
            yield _Holder(None, project)
