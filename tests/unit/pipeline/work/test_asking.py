"""Workers that ask the database for work."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import pytest
from sqlalchemy import event

from tests.world.blank import SMALL, Pipeline
from valerie.broker import Broker
from valerie.db import processes
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.db.publishing import Finished
from valerie.errors import InvalidInput
from valerie.pipeline.work.asking import ask_for_work
from valerie.pipeline.work.stages import Maker
from valerie.pipeline.work.workers import serve
from valerie.runs.products.states import EVAL_QUEUE, Stage, stage_of
from valerie.settings import NO_BROKER

RUNNING = threading.Event()


@pytest.fixture
def pipeline(pipelines: Callable[..., Pipeline]) -> Pipeline:
    return pipelines(broker_url=NO_BROKER, worker_idle_seconds=0.0)


def ask(pipeline: Pipeline, stage: Stage, maker: Maker | None = None, stop: threading.Event = RUNNING) -> None:
    routes = {product.route for product in pipeline.products() if product.route and stage_of(product.route) is stage}
    # It ends after the first round in which nothing was ready.
    context = replace(pipeline.context, broker=Broker(pipeline.settings))
    ask_for_work(context, maker or pipeline.makers[stage], sorted(routes) or [EVAL_QUEUE], stop)


def test_a_run_needs_no_broker(pipeline: Pipeline) -> None:
    run = pipeline.submit(SMALL)
    for stage in Stage:
        pipeline.loop.tick(everything=True)
        ask(pipeline, stage)
    pipeline.loop.tick(everything=True)
    ask(pipeline, Stage.EVAL)
    assert pipeline.state(run) == "completed"


def test_a_worker_that_is_asked_to_end_ends_after_the_products_in_work(pipeline: Pipeline) -> None:
    pipeline.submit(SMALL)
    pipeline.loop.tick(everything=True)
    stop = threading.Event()

    class Maker:
        def make(self, job: Job) -> Finished:
            stop.set()
            return Finished(job.digest, bytes=1, pixels=1, cpu_seconds=0.0)

    ask(pipeline, Stage.RENDER, Maker(), stop)
    states = {product.state for product in pipeline.products()}
    assert {"done", "ready"} <= states
    assert "running" not in states


class Clock(threading.Event):
    """Time that passes only while someone waits, until an end."""

    def __init__(self, end: float, at: Callable[[float], None] = lambda _now: None) -> None:
        super().__init__()
        self.now, self.pauses = 0.0, list[float]()
        self._end, self._at = end, at

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.now += timeout
        self.pauses.append(timeout)
        self._at(self.now)
        if self.now >= self._end:
            self.set()
        return self.is_set()

    def ask(self, pipeline: Pipeline, *routes: str) -> None:
        context = replace(pipeline.context, elapsed=lambda: self.now)
        ask_for_work(context, pipeline.makers[Stage.RENDER], routes, self)


@pytest.fixture
def idle(pipelines: Callable[..., Pipeline]) -> Pipeline:
    return pipelines(broker_url=NO_BROKER, worker_idle_seconds=1e4)


def test_idle_workers_only_read_and_ever_more_seldom(idle: Pipeline) -> None:
    for number in range(63):
        idle.offer(f"worker-{number}")
    statements: list[str] = []
    event.listen(idle.context.engine, "before_cursor_execute", lambda *given: statements.append(given[2]))
    clock = Clock(600.0)
    clock.ask(idle, "render.blank", "render.truth")
    assert clock.pauses[0] <= 1.0
    assert max(clock.pauses) <= 10.0
    assert 64 * len(statements) / clock.now < 50, "statements of 64 idle workers per second"
    assert not [text for text in statements if not text.startswith(("BEGIN", "SELECT")) or "IMMEDIATE" in text]


def test_a_worker_of_few_notices_a_run_within_three_seconds_and_goes_on_quickly(idle: Pipeline) -> None:
    started = list[float]()

    def submit(now: float) -> None:
        if now > 100.0 and not started:
            started.append(now)
            idle.submit(SMALL)
            idle.loop.tick(everything=True)

    clock = Clock(130.0, submit)
    made: list[tuple[float, int]] = []
    idle.makers[Stage.RENDER].before = lambda _job: made.append((clock.now, len(clock.pauses)))
    with reading(idle.context.engine) as connection:
        routes = [
            offer.route
            for offer in processes.offers(connection, now=time.time())
            if stage_of(offer.route) is Stage.RENDER
        ]
    clock.ask(idle, *routes)
    moment, pauses = made[0]
    assert moment - started[0] <= 3.0
    assert max(clock.pauses) <= 3.0
    assert min(clock.pauses[pauses:]) <= 1.0


def test_a_worker_without_work_ends_in_time(pipelines: Callable[..., Pipeline]) -> None:
    clock = Clock(1e4)
    clock.ask(pipelines(broker_url=NO_BROKER, worker_idle_seconds=20.0), "render.blank")
    assert clock.now == pytest.approx(20.0)


def test_a_worker_that_waits_for_messages_needs_a_broker(pipeline: Pipeline) -> None:
    settings = pipeline.settings.model_copy(update={"worker_idle_seconds": None})
    with pytest.raises(InvalidInput, match="VALERIE_WORKER_IDLE_SECONDS"):
        serve(settings, Stage.EVAL, probe=None, register=None, open_maker=None)  # type: ignore[arg-type]
