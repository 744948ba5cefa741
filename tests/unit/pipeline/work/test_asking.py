"""Workers that ask the database for work."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.world.blank import SMALL, Pipeline
from valerie.broker import Broker
from valerie.db.products import Finished, Job
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


def test_a_worker_that_waits_for_messages_needs_a_broker(pipeline: Pipeline) -> None:
    settings = pipeline.settings.model_copy(update={"worker_idle_seconds": None})
    with pytest.raises(InvalidInput, match="VALERIE_WORKER_IDLE_SECONDS"):
        serve(settings, Stage.EVAL, offers=[], register=None, open_maker=None)  # type: ignore[arg-type]
