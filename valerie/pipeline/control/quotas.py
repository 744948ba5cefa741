"""Quotas: how much the tokens of one owner may have unfinished at a time."""

from __future__ import annotations

from sqlalchemy import Connection

from valerie.db import runs, tokens
from valerie.errors import InvalidInput, QuotaExceeded
from valerie.settings import Settings


def require_quota(connection: Connection, settings: Settings, owner: str | None, variants: int) -> None:
    """Refuse another unfinished run that would exceed a quota of its owner.

    The owner's tokens are locked until the transaction ends, so that two requests cannot share the last room.

    Args:
        connection: of the transaction that starts the run.
        settings: of this deployment.
        owner: owner of the token that submitted it; None: the operator, who has no quotas.
        variants: number of its variants.

    Raises:
        QuotaExceeded: with the quota, the value and the limit.
    """
    if owner is None or not (settings.max_owner_runs or settings.max_owner_variants):
        return
    tokens.lock(connection, owner)
    used = runs.unfinished(connection, owner)
    for quota, use, limit in (
        ("unfinished runs", used.runs + 1, settings.max_owner_runs),
        ("variants in unfinished runs", used.variants + variants, settings.max_owner_variants),
    ):
        if limit and use > limit:
            raise QuotaExceeded(f"{owner} would have {use:,} {quota}; limit: {limit:,}")


def require_possible_batch(settings: Settings, owner: str | None, batch: int) -> None:
    """Refuse a study whose batches would wait for ever, since each alone exceeds the quota.

    Args:
        batch: variants of a batch.

    Raises:
        InvalidInput: with the size and the quota.
    """
    most = settings.max_owner_variants
    if owner is not None and most and batch > most:
        raise InvalidInput(
            f"a batch is larger than all that {owner} may have unfinished",
            field="batch",
            value=batch,
            limit=f"{most:,} variants (VALERIE_MAX_OWNER_VARIANTS)",
        )
