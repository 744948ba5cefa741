"""Find the faults of a deployment, and name a remedy for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from sqlalchemy import select

from valerie.analysis.wording import counted
from valerie.db import runs, studies, totals
from valerie.db.engine import compared_clocks, database_time, reading
from valerie.db.migrate import require_current
from valerie.db.models import Lease
from valerie.errors import ValerieError
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import monitoring, webhooks
from valerie.pipeline.control.loop import ROLE
from valerie.runs.products.states import stage_of
from valerie.settings import NO_BROKER

_SYNCHRONISE: Final = "synchronise the clocks (NTP)"


@dataclass(frozen=True, slots=True)
class Check:
    """One part of a deployment.

    Attributes:
        part: what was looked at.
        problem: what is wrong; empty if nothing is.
        remedy: what to do about it.
        state: what was found where nothing is wrong.
    """

    part: str
    state: str = ""
    problem: str = ""
    remedy: str = ""


def diagnose(context: Context, *, serverless: bool = False) -> list[Check]:
    """Look at every part, in the order in which they depend on each other; a part that does not answer is a problem.

    Args:
        context: context of the deployment.
        serverless: True for a folder without a server. It has neither broker nor control loop, and needs them only where
            something waits for them.
    """
    served: dict[str, Callable[[Context], Iterator[Check]]] = {"broker": _broker, "control loop": _control}
    parts: dict[str, Callable[[Context], Iterator[Check]]] = {
        "settings": _settings,
        "database": _database,
        "artifacts": _artifacts,
        **({"server": _no_server} if serverless else served),
        "workers": _workers,
        "runs": _runs,
        "webhooks": _webhooks,
    }
    checks = []
    for part, look in parts.items():
        try:
            checks += list(look(context))
        except ValerieError as error:
            checks.append(
                Check(part, problem=str(error), remedy=_REMEDIES.get(part, "see the row of the database above"))
            )
    return checks


_REMEDIES: Final = {
    "settings": "change the variable; docs/operations.md lists all",
    "database": "start it, or run `valerie migrate` after an upgrade",
    "broker": "`valerie up` starts one for this machine; start another, or set VALERIE_BROKER_URL; runs then continue",
    "artifacts": "free space with `valerie gc`, or repair the access; paused runs continue by themselves",
}


def _settings(context: Context) -> Iterator[Check]:
    context.settings.require_token()
    yield Check(
        "settings", "the API listens on other machines, with a token" if context.settings.exposed else "loopback only"
    )


def _database(context: Context) -> Iterator[Check]:
    require_current(context.engine)
    with reading(context.engine) as connection:
        _, ahead = compared_clocks(connection)
    yield Check("database", context.engine.url.render_as_string())
    if remark := monitoring.clock_remark(ahead):
        yield Check("clock", problem=f"this machine's clock is {remark}", remedy=_SYNCHRONISE)


def _broker(context: Context) -> Iterator[Check]:
    if context.settings.broker_url == NO_BROKER:
        yield Check("broker", "none: workers ask the database")
        return
    context.broker.queue_lengths(["eval"])
    yield Check("broker", "answers")


def _artifacts(context: Context) -> Iterator[Check]:
    context.store.check()
    free, needed = context.store.free_bytes(), context.settings.min_free_mb * 2**20
    if free is not None and free < needed:
        yield Check(
            "artifacts",
            problem=f"{free // 2**20:,} MiB are free, runs pause below {needed // 2**20:,} MiB",
            remedy=_REMEDIES["artifacts"],
        )
        return
    yield Check("artifacts", context.store.url if free is None else f"{context.store.url}, {free / 1e9:,.1f} GB free")


def _control(context: Context) -> Iterator[Check]:
    with reading(context.engine) as connection:
        now = database_time(connection)
        until = connection.scalar(select(Lease.until).where(Lease.name == ROLE, Lease.until > now))
    if until is None:
        yield Check("control loop", problem="no process has this role", remedy="start the API (`valerie up`)")
    else:
        yield Check("control loop", "at work")


def _no_server(context: Context) -> Iterator[Check]:
    with reading(context.engine) as connection:
        waiting = [f"run {run.id}" for run in runs.in_states(connection, runs.ACTIVE)]
        waiting += [f"study {study.id}" for study in studies.running(connection) if not study.by_hand]
    if waiting:
        yield Check(
            "server",
            problem=f"none runs, and work waits for one: {', '.join(waiting)}",
            remedy="`valerie up` continues it",
        )
    else:
        yield Check("server", "none runs, and no work waits for one")


def _workers(context: Context) -> Iterator[Check]:
    for worker in monitoring.workers(context):
        if worker.clock is not None:
            yield Check(
                f"clock of {worker.id}", problem=f"the clock of {worker.host} is {worker.clock}", remedy=_SYNCHRONISE
            )
        if worker.resting is not None:
            yield Check(
                f"worker {worker.id}",
                problem=f"put aside, since its last products failed and so does the test of {worker.host}: {worker.resting}",
                remedy="mend what the reason names; it tests again every minute, and then works on",
            )
    queues = monitoring.queues(context)
    with reading(context.engine) as connection:
        failures = totals.failure_reasons(connection)
    for queue in queues:
        if queue.ready is None or queue.workers is None or queue.per_minute is None:
            yield Check(
                f"queue {queue.route}",
                problem="the database does not give its numbers in time",
                remedy="look for what locks its tables or slows it",
            )
        elif queue.ready and not queue.workers:
            yield Check(
                f"queue {queue.route}",
                problem=f"ready: {counted(queue.ready, 'product')}, and no worker serves this queue",
                remedy=f"start one that offers this numeric class: `valerie worker {stage_of(queue.route)}`",
            )
        elif queue.workers:
            yield Check(
                f"queue {queue.route}",
                f"{counted(queue.workers, 'worker')}, {queue.per_minute:,.0f} products per minute",
            )
    for failure in failures:
        yield Check(
            f"failed {failure.kind}",
            problem=f"{counted(failure.products, 'product')}: {failure.type}: {failure.message}",
            remedy="mend the cause, then `valerie retry RUN`",
        )


def _runs(context: Context) -> Iterator[Check]:
    with reading(context.engine) as connection:
        active = runs.in_states(connection, runs.ACTIVE)
        backlog = totals.backlog(connection)
    for run in active:
        if run.reason:
            yield Check(
                f"run {run.id}", problem=f"{run.state}: {run.reason}", remedy="docs/operations.md#troubleshooting"
            )
    unfinished = sum(count for *_, count in backlog)
    yield Check("runs", f"{len(active):,} at work, {counted(unfinished, 'unfinished product')}")


def _webhooks(context: Context) -> Iterator[Check]:
    for host, problems in webhooks.undelivered(context).items():
        if problems:
            yield Check(
                f"webhook {host}",
                problem=f"undelivered in the last day: {len(problems):,}; {problems[0]}",
                remedy="mend the receiver or VALERIE_WEBHOOKS; requests are repeated for a day",
            )
        else:
            yield Check(f"webhook {host}", "no failed request in the last day")
