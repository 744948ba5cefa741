"""Quotas: how much the tokens of one owner, or of one project, may have unfinished, compute and store."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final

from sqlalchemy import Connection

from valerie.db import runs, tokens
from valerie.db.engine import database_moment
from valerie.db.runs import SubmittedRun
from valerie.errors import InvalidInput, QuotaExceeded
from valerie.settings import Settings

#: Runs submitted within this time count for the quota of CPU hours.
CPU_PERIOD: Final = timedelta(days=30)


@dataclass(frozen=True, slots=True)
class _Holder:
    """An owner or a project with its limits; 0 is none."""

    name: str
    owner: str | None
    project: str
    runs: int
    variants: int
    cpu_hours: float
    gigabytes: float

    @property
    def limited(self) -> bool:
        return any((self.runs, self.variants, self.cpu_hours, self.gigabytes))

    def excesses(self, connection: Connection, run: SubmittedRun, now: datetime) -> Iterator[str]:
        """Yield each quota that one more run exceeds, in words."""
        if self.runs or self.variants:
            used = runs.unfinished(connection, owner=self.owner, project=self.project)
            for quota, use, limit in (
                ("unfinished runs", used.runs + 1, self.runs),
                ("variants in unfinished runs", used.variants + run.variant_count, self.variants),
            ):
                if limit and use > limit:
                    yield f"{self.name} would have {use:,} {quota}; limit: {limit:,}"
        if self.cpu_hours:
            made = runs.made(connection, owner=self.owner, project=self.project, since=now - CPU_PERIOD)
            if (hours := made.cpu_seconds / 3600) >= self.cpu_hours:
                yield f"runs of {self.name} took {hours:,.2f} CPU hours in {CPU_PERIOD.days} days; limit: {self.cpu_hours:g}"
        if self.gigabytes:
            made = runs.made(connection, owner=self.owner, project=self.project)
            if (stored := made.bytes / 1e9) >= self.gigabytes:
                yield f"runs of {self.name} store {stored:,.3f} GB; limit: {self.gigabytes:g}; delete runs to make room"


def require_quota(connection: Connection, settings: Settings, run: SubmittedRun) -> None:
    """Refuse another run that would exceed a quota of its owner or its project.

    Their tokens are locked until the transaction ends, so that two requests cannot share the last room. The operator's runs
    have no quotas.

    Args:
        connection: of the transaction that starts the run.
        settings: of this deployment.
        run: the run.

    Raises:
        QuotaExceeded: with the quota, the value and the limit.
    """
    holders = [holder for holder in _holders(settings, run.owner, run.project) if holder.limited]
    if not holders:
        return
    tokens.lock(connection, owner=run.owner, project=run.project)
    for holder in holders:
        for excess in holder.excesses(connection, run, database_moment(connection)):
            raise QuotaExceeded(excess)


def require_possible_batch(settings: Settings, owner: str | None, project: str, batch: int) -> None:
    """Refuse a study whose batches would wait for ever, since each alone exceeds a quota.

    Args:
        settings: of this deployment.
        owner, project: of the study.
        batch: variants of a batch.

    Raises:
        InvalidInput: with the size and the quota.
    """
    for holder in _holders(settings, owner, project):
        if holder.variants and batch > holder.variants:
            raise InvalidInput(
                f"a batch is larger than all that {holder.name} may have unfinished",
                field="batch",
                value=batch,
                limit=f"{holder.variants:,} variants (VALERIE_MAX_{'PROJECT' if holder.owner is None else 'OWNER'}_VARIANTS)",
            )


def _holders(settings: Settings, owner: str | None, project: str) -> Iterator[_Holder]:
    """Yield the owner and the project of a run; none of an operator's run."""
    if owner is None:
        return
    yield _Holder(
        owner,
        owner,
        "",
        settings.max_owner_runs,
        settings.max_owner_variants,
        settings.max_owner_cpu_hours,
        settings.max_owner_gigabytes,
    )
    if project:
        yield _Holder(
            f"project {project}",
            None,
            project,
            settings.max_project_runs,
            settings.max_project_variants,
            settings.max_project_cpu_hours,
            settings.max_project_gigabytes,
        )
