"""Health of this process's dependencies, and Prometheus metrics read from the database and the broker."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass
from functools import partial
from threading import Lock, Thread
from typing import Any, Final, NamedTuple, TypeVar

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeHistogramMetricFamily, GaugeMetricFamily, Metric
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
    ProductKind,
    ProductState,
    RunState,
    Stage,
    engine_of,
    stage_of,
)

#: A part that does not answer a check in this time is reported as unknown.
CHECK_SECONDS = 5.0
#: Difference between two clocks that is worth a remark, seconds.
_CLOCK_SECONDS: Final = 5.0
#: Time over which the rate of a queue is counted.
_RATE_SECONDS: Final = 120.0
#: Spans of time in which costs are shown.
_SPANS: Final = 60
#: Most products of a kind, and most failures, that one scrape reads.
_NEWEST: Final = 1_000
#: Upper bounds of the histogram of costs, CPU seconds, as Prometheus writes them.
_COST_BOUNDS: Final = (
    "0.01", "0.03", "0.1", "0.3", "1.0", "3.0", "10.0", "30.0", "100.0", "300.0", "1000.0", "+Inf"
)  # fmt: skip
#: Questions that still wait for an answer, by deployment and name.
_waiting: dict[tuple[int, str], Future[Any]] = {}
_asking = Lock()
_T = TypeVar("_T")


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
    answers = _ask(context, checks)
    return {name: str(answer) if isinstance(answer, ValerieError) else "ok" for name, answer in answers.items()}


def _ask(context: Context, questions: Mapping[str, Callable[[], _T]]) -> dict[str, _T | ValerieError]:
    """Return the answers that come within `CHECK_SECONDS`, and errors in place of the others.

    Who asks while another still waits for the same answer waits for that one, so that no thread is added.
    """

    def answer(future: Future[_T], question: Callable[[], _T]) -> None:
        try:
            future.set_result(question())
        except BaseException as error:
            future.set_exception(error)

    futures: dict[str, Future[_T]] = {}
    with _asking:
        for name, question in questions.items():
            key = (id(context), name)
            if key not in _waiting or _waiting[key].done():
                _waiting[key] = Future()
                Thread(target=answer, args=(_waiting[key], question), name=f"ask-{name}", daemon=True).start()
            futures[name] = _waiting[key]
    wait(futures.values(), timeout=CHECK_SECONDS)
    silent = TransientError(f"it does not answer within {CHECK_SECONDS:g} s")
    answers: dict[str, _T | ValerieError] = {}
    for name, future in futures.items():
        try:
            answers[name] = future.result(timeout=0)
        except TimeoutError:
            answers[name] = silent
        except ValerieError as error:
            answers[name] = error
    return answers


def metrics(context: Context) -> str:
    """Return metrics in the Prometheus text format; those of a part that does not answer are left out."""
    registry = CollectorRegistry()
    registry.register(_Collector(context))
    return generate_latest(registry).decode()


class Queue(NamedTuple):
    """A queue.

    A number is None if database or broker do not give it in time.

    Attributes:
        route: its name.
        waiting, ready, running: unfinished products.
        messages: number of messages in the broker.
        workers: number of living workers that serve it and do not rest.
        per_minute: products done in the last minutes, per minute.
    """

    route: str
    waiting: int | None
    ready: int | None
    running: int | None
    messages: int | None
    workers: int | None
    per_minute: float | None


class _Products(NamedTuple):
    """Numbers of unfinished products by route and state, and of those done lately by route."""

    counts: dict[tuple[str, ProductState], int]
    done: dict[str, int]


def queues(context: Context) -> list[Queue]:
    """Return all queues whose names can be read, sorted by route, within twice `CHECK_SECONDS`.

    Raises:
        TransientError: the database does not answer.
    """

    def products() -> _Products:
        with reading(context.engine) as connection:
            counts = {(route, state): count for route, state, count in totals.backlog(connection)}
            return _Products(counts, totals.done_since(connection, database_time(connection) - _RATE_SECONDS))

    def serving() -> Counter[str]:
        with reading(context.engine) as connection:
            alive = processes.workers(connection, now=database_time(connection))
        numbers: Counter[str] = Counter()
        for worker in (candidate for candidate in alive if candidate.resting is None):
            numbers.update(
                {offer.route for offer in worker.offers} | ({EVAL_QUEUE} if worker.stage is Stage.EVAL else set())
            )
        return numbers

    questions: dict[str, Callable[[], _Products | Counter[str]]] = {"products of queues": products, "workers": serving}
    made, workers = _ask(context, questions).values()
    if isinstance(made, ValerieError) and isinstance(workers, ValerieError):
        raise made
    routes = {EVAL_QUEUE} | (workers.keys() if isinstance(workers, Counter) else set())
    routes |= {route for route, _ in made.counts} if isinstance(made, _Products) else set()
    messages = _messages(context, routes)

    def count(route: str, state: ProductState) -> int | None:
        return made.counts.get((route, state), 0) if isinstance(made, _Products) else None

    return [
        Queue(
            route=route,
            waiting=count(route, ProductState.WAITING),
            ready=count(route, ProductState.READY),
            running=count(route, ProductState.RUNNING),
            messages=messages.get(route),
            workers=workers[route] if isinstance(workers, Counter) else None,
            per_minute=made.done.get(route, 0) * 60 / _RATE_SECONDS if isinstance(made, _Products) else None,
        )
        for route in sorted(routes)
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
        if state in (ProductState.READY, ProductState.RUNNING):
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

    @property
    def clock(self) -> str | None:
        """What `clock_remark` says of its clock at its last heartbeat."""
        return clock_remark(self.clock_ahead or 0.0)


def clock_remark(ahead: float) -> str | None:
    """Return in words how many seconds a clock is ahead of the database's, and what that does; None if it does nothing.

    Leases, heartbeats and the times of runs are by the database's clock alone.
    """
    if abs(ahead) <= _CLOCK_SECONDS:
        return None
    return (
        f"{abs(ahead):,.0f} s {'ahead of' if ahead > 0 else 'behind'} the database's: results are right, but times in its log "
        "and traces are wrong, and S3 refuses requests of a clock that is 15 minutes off"
    )


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
    """Return cost and failures of the last hours, and the space left.

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
        questions = {f"metrics of {name}": partial(read, self._context) for name, read in _READS.items()}
        answers = zip(_READS, _ask(self._context, questions).values(), strict=True)
        known = {name: answer for name, answer in answers if isinstance(answer, list)}
        metrics = [metric for answer in known.values() for metric in answer]
        routes = {sample.labels["route"] for metric in metrics for sample in metric.samples if "route" in sample.labels}
        messages = _messages(self._context, sorted(routes | {EVAL_QUEUE}))
        up = GaugeMetricFamily(
            "valerie_up", "Whether a part answers; without it, its metrics are unknown", labels=["part"]
        )
        up.add_metric(["database"], float(known.keys() == _READS.keys()))
        up.add_metric(["broker"], float(bool(messages)))
        yield up
        unknown = GaugeMetricFamily(
            "valerie_unknown", "Whether the database did not give these metrics in time", labels=["metrics"]
        )
        for name in _READS:
            unknown.add_metric([name], float(name not in known))
        yield unknown
        depth = GaugeMetricFamily("valerie_queue_messages", "Messages waiting in a queue", labels=["route"])
        for route, count in messages.items():
            depth.add_metric([route], count)
        yield depth
        yield from metrics


def _product_metrics(context: Context) -> list[Metric]:
    with reading(context.engine) as connection:
        unfinished, ended = totals.backlog(connection), totals.totals(connection)
        newest = totals.newest_costs(connection, newest=_NEWEST)
        failures = totals.failure_reasons(connection, newest=_NEWEST)
    backlog = GaugeMetricFamily("valerie_products", "Unfinished products", labels=["route", "state"])
    for route, state, count in unfinished:
        backlog.add_metric([route, state], count)
    done = CounterMetricFamily("valerie_products_done", "Products made", labels=["kind"])
    failed = CounterMetricFamily("valerie_products_failed", "Products that failed for good", labels=["kind"])
    cpu = CounterMetricFamily("valerie_stage_cpu_seconds", "CPU seconds spent on finished products", labels=["kind"])
    for kind, done_count, failed_count, seconds in ended:
        done.add_metric([kind], done_count)
        failed.add_metric([kind], failed_count)
        cpu.add_metric([kind], seconds)
    costs = GaugeHistogramMetricFamily(
        "valerie_product_cpu_seconds", f"CPU seconds of the newest {_NEWEST:,} products of a kind", labels=["kind"]
    )
    for kind, values in newest:
        counts = [(bound, sum(value <= float(bound) for value in values)) for bound in _COST_BOUNDS]
        costs.add_metric([kind], counts, sum(values))
    reasons = GaugeMetricFamily(
        "valerie_failure_reasons",
        f"Products that failed for good, of the newest {_NEWEST:,} failures",
        labels=["kind", "error"],
    )
    for reason in failures:
        reasons.add_metric([reason.kind, reason.type], reason.products)
    return [backlog, done, failed, cpu, costs, reasons]


def _worker_metrics(context: Context) -> list[Metric]:
    with reading(context.engine) as connection:
        alive = processes.workers(connection, now=database_time(connection))
    workers = GaugeMetricFamily("valerie_workers", "Living worker processes", labels=["stage"])
    for stage in Stage:
        workers.add_metric([stage], sum(1 for worker in alive if worker.stage is stage))
    return [workers]


def _run_metrics(context: Context) -> list[Metric]:
    with reading(context.engine) as connection:
        counts = runs.count_by_state(connection)
    by_state = GaugeMetricFamily("valerie_runs", "Runs by state", labels=["state"])
    for state, count in counts.items():
        by_state.add_metric([state], count)
    return [by_state]


_READS: Final = {"products": _product_metrics, "workers": _worker_metrics, "runs": _run_metrics}
