"""Quotas: how much the tokens of one owner, or of one project, may have unfinished at a time."""

from __future__ import annotations

from sqlalchemy import Connection

from valerie.db import runs, tokens
from valerie.db.runs import SubmittedRun
from valerie.errors import InvalidInput, QuotaExceeded
from valerie.settings import Settings


def require_quota(connection: Connection, settings: Settings, run: SubmittedRun) -> None:
    """Refuse another unfinished run that would exceed a quota of its owner or its project.

    Their tokens are locked until the transaction ends, so that two requests cannot share the last room. The operator's runs
    have no quotas.

    Args:
        connection: of the transaction that starts the run.
        settings: of this deployment.
        run: the run.

    Raises:
        QuotaExceeded: with the quota, the value and the limit.
    """
    limits: list[tuple[str, dict[str, str], int, int]] = []
    if run.owner is not None:
        limits.append((run.owner, {"owner": run.owner}, settings.max_owner_runs, settings.max_owner_variants))
        if run.project:
            of_project = settings.max_project_runs, settings.max_project_variants
            limits.append((f"project {run.project}", {"project": run.project}, *of_project))
    if not any(most_runs or most_variants for *_, most_runs, most_variants in limits):
        return
    tokens.lock(connection, owner=run.owner, project=run.project)
    for holder, held, most_runs, most_variants in limits:
        used = runs.unfinished(connection, **held)
        for quota, use, limit in (
            ("unfinished runs", used.runs + 1, most_runs),
            ("variants in unfinished runs", used.variants + run.variant_count, most_variants),
        ):
            if limit and use > limit:
                raise QuotaExceeded(f"{holder} would have {use:,} {quota}; limit: {limit:,}")


def require_possible_batch(settings: Settings, owner: str | None, project: str, batch: int) -> None:
    """Refuse a study whose batches would wait for ever, since each alone exceeds a quota.

    Args:
        settings: of this deployment.
        owner, project: of the study.
        batch: variants of a batch.

    Raises:
        InvalidInput: with the size and the quota.
    """
    if owner is None:
        return
    for holder, most, setting in (
        (owner, settings.max_owner_variants, "VALERIE_MAX_OWNER_VARIANTS"),
        (f"project {project}" if project else "", settings.max_project_variants, "VALERIE_MAX_PROJECT_VARIANTS"),
    ):
        if holder and most and batch > most:
            raise InvalidInput(
                f"a batch is larger than all that {holder} may have unfinished",
                field="batch",
                value=batch,
                limit=f"{most:,} variants ({setting})",
            )
