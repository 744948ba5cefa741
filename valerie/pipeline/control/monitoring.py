"""Health of what this process needs, and Prometheus metrics read from the database and the broker."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from sqlalchemy import text

from valerie.db import processes, runs, totals
from valerie.db.engine import database_time, reading
from valerie.errors import TransientError, ValerieError
from valerie.pipeline.base.context import Context
from valerie.runs.states import EVAL_QUEUE, ProductState, Stage


def check(context: Context) -> dict[str, str]:
    """Return ``ok``, or what is wrong, for database, broker and artifact store."""

    def database() -> None:
        with reading(context.engine) as connection:
            connection.execute(text("SELECT 1"))

    checks = {
        "database": database,
        "broker": lambda: context.broker.queue_length(EVAL_QUEUE),
        "artifacts": context.store.check,
    }
    answers = {}
    for name, call in checks.items():
        try:
            call()
            answers[name] = "ok"
        except ValerieError as error:
            answers[name] = str(error)
    return answers


def metrics(context: Context) -> str:
    """Return metrics in the Prometheus text format.

    Raises:
        TransientError: the database does not answer.
    """
    registry = CollectorRegistry()
    registry.register(_Collector(context))
    return generate_latest(registry).decode()


class Queue(NamedTuple):
    """A queue.

    Attributes:
        route: its name.
        waiting, ready, running: unfinished products.
        messages: in the broker; None where it does not answer.
        workers: living workers that serve it.
    """

    route: str
    waiting: int
    ready: int
    running: int
    messages: int | None
    workers: int


def queues(context: Context) -> list[Queue]:
    """Return all queues by route.

    Raises:
        TransientError: the database does not answer.
    """
    with reading(context.engine) as connection:
        backlog = totals.backlog(connection)
        alive = processes.workers(connection, now=database_time(connection))
    serving: Counter[str] = Counter()
    for worker in alive:
        serving.update(
            {offer.route for offer in worker.offers} | ({EVAL_QUEUE} if worker.stage is Stage.EVAL else set())
        )
    counts = {(route, state): count for route, state, count in backlog}
    listed = []
    answering = True
    for route in sorted({route for route, _ in counts} | serving.keys() | {EVAL_QUEUE}):
        messages = None
        if answering:
            try:
                messages = context.broker.queue_length(route)
            except TransientError:
                answering = False  # one time-out is enough
        listed.append(
            Queue(
                route=route,
                waiting=counts.get((route, ProductState.WAITING), 0),
                ready=counts.get((route, ProductState.READY), 0),
                running=counts.get((route, ProductState.RUNNING), 0),
                messages=messages,
                workers=serving[route],
            )
        )
    return listed


class _Collector:
    """Reads everything at scrape time: any process can be asked, and none has to keep count."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def collect(self) -> Iterator[Metric]:
        """Return the metrics of this moment."""
        with reading(self._context.engine) as connection:
            unfinished = totals.backlog(connection)
            kinds = totals.totals(connection)
            alive = processes.workers(connection, now=database_time(connection))
            states = runs.count_by_state(connection)
        backlog = GaugeMetricFamily("valerie_products", "Unfinished products", labels=["route", "state"])
        for route, state, count in unfinished:
            backlog.add_metric([route, state], count)
        yield backlog
        depth = GaugeMetricFamily("valerie_queue_messages", "Messages waiting in a queue", labels=["route"])
        for route in sorted({route for route, _, _ in unfinished} | {EVAL_QUEUE}):
            try:
                depth.add_metric([route], self._context.broker.queue_length(route))
            except TransientError:
                break
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
