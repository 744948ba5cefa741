"""Health of this process's dependencies, and Prometheus metrics read from the database and the broker."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from threading import Thread
from typing import Final, NamedTuple

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from sqlalchemy import text

from valerie import plugins
from valerie.db import processes, runs, totals
from valerie.db.engine import database_time, reading
from valerie.db.processes import WorkerRow
from valerie.errors import TransientError, ValerieError
from valerie.pipeline.base.context import Context
from valerie.runs.products.pins import TRUTH
from valerie.runs.products.states import (
    EVAL_QUEUE,
    UPLOADED_ROUTE,
    ProductKind,
    ProductState,
    RunState,
    Stage,
    engine_of,
    stage_of,
)

#: A part that does not answer a check in this time is reported as unknown.
CHECK_SECONDS = 5.0
#: Time over which the rate of a queue is counted.
_RATE_SECONDS: Final = 120.0
#: Spans of time in which costs are shown.
_SPANS: Final = 60
#: Checks that still wait for an answer, by deployment and name.
_waiting: dict[tuple[int, str], Thread] = {}


def check(context: Context) -> dict[str, str]:
    """Return ``ok`` or the problem of database, broker and artifact store, within `CHECK_SECONDS`."""

    def database() -> None:
        with reading(context.engine) as connection:
            connection.execute(text("SELECT 1"))

    checks: dict[str, Callable[[], object]] = {
        "database": database,
        "broker": lambda: context.broker.queue_lengths([EVAL_QUEUE]),
        "artifacts": context.store.check,
    }
    answers = dict.fromkeys(checks, f"it does not answer within {CHECK_SECONDS:g} s")

    def ask(name: str) -> None:
        try:
            checks[name]()
            answers[name] = "ok"
        except ValerieError as error:
            answers[name] = str(error)

    deadline = time.monotonic() + CHECK_SECONDS
    threads = []
    for name in checks:
        key = (id(context), name)
        if key in _waiting and _waiting[key].is_alive():  # from an earlier call: a second thread would wait too
            continue
        thread = _waiting[key] = Thread(target=ask, args=(name,), name=f"check-{name}", daemon=True)
        thread.start()
        threads.append(thread)
    for thread in threads:
        thread.join(timeout=max(0.0, deadline - time.monotonic()))
    return dict(answers)


def metrics(context: Context) -> str:
    """Return metrics in the Prometheus text format; those of a part that does not answer are left out."""
    registry = CollectorRegistry()
    registry.register(_Collector(context))
    return generate_latest(registry).decode()


class Queue(NamedTuple):
    """A queue.

    Attributes:
        route: its name.
        waiting, ready, running: unfinished products.
        messages: number of messages in the broker; None if it does not answer.
        workers: number of living workers that serve it and do not rest.
        per_minute: products done in the last minutes, per minute.
    """

    route: str
    waiting: int
    ready: int
    running: int
    messages: int | None
    workers: int
    per_minute: float


def queues(context: Context) -> list[Queue]:
    """Return all queues, sorted by route.

    Raises:
        TransientError: the database does not answer.
    """
    with reading(context.engine) as connection:
        backlog = totals.backlog(connection)
        now = database_time(connection)
        alive = processes.workers(connection, now=now)
        done = totals.done_since(connection, now - _RATE_SECONDS)
    serving: Counter[str] = Counter()
    for worker in (candidate for candidate in alive if candidate.resting is None):
        serving.update(
            {offer.route for offer in worker.offers} | ({EVAL_QUEUE} if worker.stage is Stage.EVAL else set())
        )
    counts = {(route, state): count for route, state, count in backlog}
    routes = sorted({route for route, _ in counts} | serving.keys() | {EVAL_QUEUE})
    messages = _messages(context, routes)
    return [
        Queue(
            route=route,
            waiting=counts.get((route, ProductState.WAITING), 0),
            ready=counts.get((route, ProductState.READY), 0),
            running=counts.get((route, ProductState.RUNNING), 0),
            messages=messages.get(route),
            workers=serving[route],
            per_minute=done.get(route, 0) * 60 / _RATE_SECONDS,
        )
        for route in routes
    ]


class Demand(NamedTuple):
    """Work for each pool of workers: products that are ready or leased, and runs that wait for such a worker.

    A number above zero calls for a worker, whatever the broker's queues hold; workers prefetch their messages.

    Attributes:
        render: by engine, and ``truth``.
        infer, eval: of their stages; a run that waits for its results counts for ``eval``.
    """

    render: dict[str, int]
    infer: int
    eval: int


def demand(context: Context) -> Demand:
    """Return the work for each pool, for autoscalers.

    Raises:
        TransientError: the database does not answer.
    """
    with reading(context.engine) as connection:
        backlog = totals.backlog(connection)
        submitted = runs.in_states(connection, (RunState.SUBMITTED,))
        finishing = runs.count_by_state(connection).get(RunState.FINISHING, 0)
    products: Counter[str] = Counter()
    for route, state, count in backlog:
        if route != UPLOADED_ROUTE and state in (ProductState.READY, ProductState.RUNNING):
            stage = stage_of(route)
            products[engine_of(route) if stage is Stage.RENDER else stage] += count
    waiting = Counter(run.spec.engine for run in submitted)
    engines = (*plugins.renderer_names(testing=context.settings.testing_engines), TRUTH)
    return Demand(
        render={engine: products[engine] + waiting[engine] for engine in engines},
        infer=products[Stage.INFER] + len(submitted),
        eval=products[Stage.EVAL] + finishing,
    )


@dataclass(frozen=True, kw_only=True)
class BusyWorker(WorkerRow):
    """A living worker, and how many products of each kind it makes now."""

    makes: dict[ProductKind, int]


def workers(context: Context) -> list[BusyWorker]:
    """Return the living workers with what they do, longest-serving first."""
    with reading(context.engine) as connection:
        alive = processes.workers(connection, now=database_time(connection))
        held = totals.held(connection)
    makes: defaultdict[str, Counter[ProductKind]] = defaultdict(Counter)
    for owner, kind, products in held:
        makes[processes.worker_of(owner)][kind] += products
    return [BusyWorker(**vars(worker), makes=dict(makes[worker.id])) for worker in alive]


@dataclass(frozen=True, slots=True)
class CostSeries:
    """The cost of one kind of product over time.

    Attributes:
        kind: of the product.
        products: done in each span of time.
        cpu_seconds: mean of these; None for a span without any.
    """

    kind: ProductKind
    products: list[int]
    cpu_seconds: list[float | None]


@dataclass(frozen=True, slots=True)
class Work:
    """The recent products of a deployment, and the space left.

    Attributes:
        since: beginning of the first span of time, Unix seconds.
        span_s: length of a span.
        costs: of the kinds that were made.
        failures: reasons of products that failed for good.
        free_bytes: of the artifact folder; None for a bucket.
        min_free_bytes: free space below which runs pause.
    """

    since: float
    span_s: float
    costs: list[CostSeries]
    failures: list[totals.FailureReason]
    free_bytes: int | None
    min_free_bytes: int


def work(context: Context, hours: int) -> Work:
    """Return what was made in the last hours, and the space left.

    Raises:
        StorageUnavailable: the artifact folder cannot be read.
    """
    width = hours * 3600 // _SPANS
    with reading(context.engine) as connection:
        since = int(database_time(connection)) - width * _SPANS
        bins = totals.costs_since(connection, since, width)
        failures = totals.failure_reasons(connection)
    costs = {span.kind: CostSeries(span.kind, [0] * _SPANS, [None] * _SPANS) for span in bins}
    for span in bins:
        number = min(span.number, _SPANS - 1)
        costs[span.kind].products[number] = span.products
        costs[span.kind].cpu_seconds[number] = span.cpu_seconds / span.products
    return Work(
        since=float(since),
        span_s=float(width),
        costs=list(costs.values()),
        failures=failures,
        free_bytes=context.store.free_bytes(),
        min_free_bytes=context.settings.min_free_mb * 2**20,
    )


def _messages(context: Context, routes: Collection[str]) -> dict[str, int]:
    """Return the number of messages in each queue; empty if the broker does not answer."""
    try:
        return context.broker.queue_lengths(routes)
    except TransientError:
        return {}


class _Collector:
    """Collector that reads everything at scrape time, so any process can be scraped and none has to keep count."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def collect(self) -> Iterator[Metric]:
        """Return the metrics of this moment."""
        up = GaugeMetricFamily(
            "valerie_up", "Whether a part answers; without it, its metrics are unknown", labels=["part"]
        )
        try:
            with reading(self._context.engine) as connection:
                unfinished = totals.backlog(connection)
                kinds = totals.totals(connection)
                alive = processes.workers(connection, now=database_time(connection))
                states = runs.count_by_state(connection)
        except TransientError:
            up.add_metric(["database"], 0)
            up.add_metric(["broker"], float(bool(_messages(self._context, [EVAL_QUEUE]))))
            yield up
            return
        messages = _messages(self._context, sorted({route for route, _, _ in unfinished} | {EVAL_QUEUE}))
        up.add_metric(["database"], 1)
        up.add_metric(["broker"], float(bool(messages)))
        yield up
        backlog = GaugeMetricFamily("valerie_products", "Unfinished products", labels=["route", "state"])
        for route, state, count in unfinished:
            backlog.add_metric([route, state], count)
        yield backlog
        depth = GaugeMetricFamily("valerie_queue_messages", "Messages waiting in a queue", labels=["route"])
        for route, count in messages.items():
            depth.add_metric([route], count)
        yield depth
        done = CounterMetricFamily("valerie_products_done", "Products made", labels=["kind"])
        failed = CounterMetricFamily("valerie_products_failed", "Products that failed for good", labels=["kind"])
        cpu = CounterMetricFamily(
            "valerie_stage_cpu_seconds", "CPU seconds spent on finished products", labels=["kind"]
        )
        for kind, done_count, failed_count, seconds in kinds:
            done.add_metric([kind], done_count)
            failed.add_metric([kind], failed_count)
            cpu.add_metric([kind], seconds)
        yield from (done, failed, cpu)
        workers = GaugeMetricFamily("valerie_workers", "Living worker processes", labels=["stage"])
        for stage in Stage:
            workers.add_metric([stage], sum(1 for worker in alive if worker.stage is stage))
        yield workers
        by_state = GaugeMetricFamily("valerie_runs", "Runs by state", labels=["state"])
        for run_state, count in states.items():
            by_state.add_metric([run_state], count)
        yield by_state
