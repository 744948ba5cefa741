"""A worker that fails everything is put aside; one that met bad products is not."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import processes, sweeping
from valerie.db.claiming import Job
from valerie.db.engine import writing
from valerie.db.publishing import Finished
from valerie.errors import MissingDependency, RenderingError
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.fitness import Fitness
from valerie.pipeline.control import monitoring
from valerie.pipeline.work.asking import ask_for_work
from valerie.pipeline.work.stages import serve_queue
from valerie.pipeline.work.workers import ailment, render_offers
from valerie.runs.products.states import ProductKind, Stage


class Machine:
    """A worker whose driver may be broken, or end its process."""

    def __init__(self, *, works: bool) -> None:
        self.works, self.tests = works, 0
        self.tried: list[str] = []
        self.error: BaseException | None = RenderingError("the driver is gone")

    def test(self) -> bool:
        self.tests += 1
        return self.works

    def make(self, job: Job) -> Finished:
        self.tried.append(job.digest)
        if self.error is not None:
            raise self.error
        return Finished(job.digest, bytes=1, pixels=1, cpu_seconds=0.0)


def layers(pipeline: Pipeline) -> str:
    """Feed 16 layers in one queue; return its route."""
    pipeline.submit(spec(xs=16, ys=1))
    pipeline.loop.tick(everything=True)
    return next(ready.route for ready in pipeline.broker.ready if ready.kind is ProductKind.LAYER)


def worker(pipeline: Pipeline, machine: Machine) -> Context:
    return replace(pipeline.context, fitness=Fitness(machine.test))


def test_a_worker_that_fails_three_products_and_its_test_makes_no_more(pipeline: Pipeline) -> None:
    route, machine = layers(pipeline), Machine(works=False)
    context = worker(pipeline, machine)
    for _ in range(5):
        serve_queue(context, machine, route)
    assert len(set(machine.tried)) == len(machine.tried) == 3
    rest = [product for product in pipeline.products() if product.route == route and product.state != "failed"]
    assert {(product.state, product.attempts, product.lease_owner) for product in rest} == {("ready", 0, None)}


def test_it_works_again_when_its_test_passes(pipeline: Pipeline) -> None:
    route, machine = layers(pipeline), Machine(works=False)
    context = worker(pipeline, machine)
    while serve_queue(context, machine, route):
        pass
    machine.works, machine.error = True, None
    while serve_queue(context, machine, route):
        pass
    states = [product.state for product in pipeline.products() if product.route == route]
    assert sorted(set(states)) == ["done", "failed"]
    assert states.count("failed") == 3


def test_a_healthy_worker_goes_on_however_many_products_fail(pipeline: Pipeline) -> None:
    route, machine = layers(pipeline), Machine(works=True)
    context = worker(pipeline, machine)
    while serve_queue(context, machine, route):
        pass
    assert {product.state for product in pipeline.products() if product.route == route} == {"failed"}
    assert machine.tests <= 4  # after 3, 6, 12 and 24 failures


def test_children_that_die_count_as_failures(pipeline: Pipeline) -> None:
    route, machine = layers(pipeline), Machine(works=False)
    machine.error = KeyboardInterrupt()  # nothing of the process goes on
    counts = Fitness.counts()
    for _ in range(6):
        child = replace(pipeline.context, fitness=Fitness(machine.test, counts))
        try:
            serve_queue(child, machine, route)
        except KeyboardInterrupt:
            with writing(pipeline.context.engine) as connection:
                sweeping.take_back_expired(connection, now=1e12, max_attempts=pipeline.settings.max_attempts)
    assert len(machine.tried) == 3


def test_a_job_of_a_batch_system_ends_with_the_reason(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(worker_idle_seconds=0.0)
    route, machine = layers(pipeline), Machine(works=False)
    with pytest.raises(MissingDependency, match="cannot make products any more"):
        ask_for_work(worker(pipeline, machine), machine, [route], threading.Event())


def test_a_worker_that_rests_offers_nothing_and_says_why(pipeline: Pipeline) -> None:
    layers(pipeline)
    (before, *_) = (one for one in monitoring.workers(pipeline.context) if one.stage is Stage.RENDER)
    with writing(pipeline.context.engine) as connection:
        processes.rest(connection, before.id, "raster: no device")
    (resting,) = (one for one in monitoring.workers(pipeline.context) if one.id == before.id)
    assert resting.resting == "raster: no device"
    served = {queue.route: queue.workers for queue in monitoring.queues(pipeline.context)}
    assert {served[offer.route] for offer in before.offers if offer.route in served} == {0}
    with writing(pipeline.context.engine) as connection:
        processes.rest(connection, before.id, None)
    assert {one.resting for one in monitoring.workers(pipeline.context)} == {None}


def test_a_machine_is_ill_when_it_does_not_offer_what_it_did(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALERIE_TESTING_ENGINES", "true")
    offers = render_offers(["blank"]).offers
    assert ailment(Stage.RENDER, offers) is None
    other = [
        offer.model_copy(update={"numeric_class": "old", "route": "render.blank.old"})
        for offer in offers
        if offer.name == "blank"
    ]
    assert "numeric class old" in str(ailment(Stage.RENDER, other))
    gone = [offer.model_copy(update={"name": "nothing"}) for offer in other]
    assert str(ailment(Stage.RENDER, gone)).startswith("nothing: ")
