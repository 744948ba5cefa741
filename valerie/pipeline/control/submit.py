"""Submit a run: check everything, then store one row with the spec and the number of variants."""

from __future__ import annotations

import secrets
from datetime import UTC, datetime

from valerie.db import processes, runs
from valerie.db.engine import database_time, reading, writing
from valerie.db.runs import SubmittedRun
from valerie.errors import NotFound, QuotaExceeded
from valerie.parameters.assignment import digest
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import pins_for
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.control.planning import forecast
from valerie.pipeline.control.quotas import limits_costs, require_quota, spent_by
from valerie.pipeline.functions import registry
from valerie.runs.products.states import Priority, RunState
from valerie.runs.resolving.spec import RunSpec

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"  # Crockford's base 32: no letter looks like a digit


def submit(
    context: Context,
    spec: RunSpec,
    *,
    idempotency_key: str | None = None,
    priority: Priority = Priority.NORMAL,
    deadline: datetime | None = None,
    owner: str | None = None,
    project: str = "",
) -> str:
    """Store a run and return its id; the control loop does the rest.

    Args:
        context: of this process.
        spec: spec of the run.
        idempotency_key: a run with this key is not stored again; its id is returned.
        priority: its part of the workers beside other runs of its owner.
        deadline: when it should be done; its part grows as the time gets short.
        owner: owner of the token that submits it; None: the operator.
        project: of that token; empty: none. A key belongs to it, and so does a parent.

    Raises:
        InvalidInput: an unknown name, a bound, a size: with field, value and limit.
        Conflict: the idempotency key belongs to another spec.
        QuotaExceeded: a quota of the owner or the project has no room for it.
        NotFound: ``parent_run`` does not exist.
    """
    with reading(context.engine) as connection:
        now = database_time(connection)
        offers = processes.offers_by_worker(connection, now=now)
        registered = registry.known(connection, spec.functions)
        names = registry.names(connection, registered)
    resolved = resolve_new(spec, context.settings, registered=names)
    tenant, expected = context.settings.tenant_of(project), None
    with reading(context.engine) as connection:
        pins, reason = pins_for(connection, spec, offers, registered, lambda: resolved.space)
        if limits_costs(context.settings, owner, project):
            expected = forecast(connection, resolved, pins, tenant)
        spent = spent_by(connection, context.settings, [(owner, project)])
    run = SubmittedRun(
        id=new_id("r", now),
        name=spec.name,
        state=RunState.SUBMITTED,
        reason=reason,
        spec=spec,
        spec_digest=spec.digest,
        asset_digest=resolved.asset_digest,
        pins=pins,
        parent_run=spec.parent_run,
        iteration=spec.iteration,
        variant_count=resolved.space.size,
        priority=priority,
        deadline=deadline,
        owner=owner,
        project=project,
        tenant=tenant,
        forecast=expected,
        created_at=datetime.fromtimestamp(now, UTC),
    )
    # Another project's key must be neither refused nor recognised.
    key = digest("key", project, idempotency_key) if project and idempotency_key is not None else idempotency_key
    with writing(context.engine) as connection:
        if spec.parent_run is not None:
            try:
                runs.require(connection, spec.parent_run, project=project)
            except NotFound:
                raise NotFound("parent run", spec.parent_run) from None
        try:
            require_quota(connection, context.settings, run, spent)
        except QuotaExceeded:
            # Another request may have stored the same key while this one waited for the owner's tokens.
            if runs.of_key(connection, key, spec.digest) is None:
                raise
        return runs.create(connection, run, idempotency_key=key)


def new_id(prefix: str, now: float) -> str:
    """Return a short id that sorts by time: the prefix, seven characters of seconds, five random ones."""
    seconds = int(now)
    stamp = "".join(_ALPHABET[seconds >> shift & 31] for shift in range(30, -1, -5))
    return prefix + stamp + "".join(secrets.choice(_ALPHABET) for _ in range(5))
