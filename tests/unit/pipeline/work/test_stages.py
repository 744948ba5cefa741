"""A worker's batch and the heartbeat that renews its leases, with the one write lock of SQLite between them."""

from __future__ import annotations

import threading
from collections.abc import Callable

from sqlalchemy import Connection, event

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import sweeping
from valerie.db.claiming import Job
from valerie.db.engine import writing
from valerie.db.publishing import Finished
from valerie.pipeline.work.stages import make_products, serve_queue
from valerie.runs.products.states import ProductKind, Stage, stage_of


def test_a_batch_is_published_while_its_heartbeat_writes(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(heartbeat_seconds=0.01)
    pipeline.submit(spec(xs=1, ys=1))
    pipeline.loop.tick(everything=True)
    digests = [ready.digest for ready in pipeline.broker.ready if stage_of(ready.route) is Stage.RENDER]
    worker, beating, publishing = threading.get_ident(), threading.Event(), threading.Event()

    class Maker:
        """Ends its last product only while the heartbeat holds the database's write lock."""

        def make(self, job: Job) -> Finished:
            if job.digest == digests[-1]:
                event.listen(pipeline.context.engine, "checkout", before_a_transaction)
                event.listen(pipeline.context.engine, "begin", in_a_transaction)
                assert beating.wait(30)
            return Finished(job.digest, bytes=1, pixels=1, cpu_seconds=0.0)

    def before_a_transaction(*_: object) -> None:
        if threading.get_ident() == worker:
            publishing.set()

    def in_a_transaction(_: Connection) -> None:
        if threading.get_ident() != worker:
            beating.set()
            assert publishing.wait(30)

    make_products(pipeline.context, Maker(), digests)
    states = {product.digest: product.state for product in pipeline.products()}
    assert {states[digest] for digest in digests} == {"done"}


def test_a_product_that_ends_its_process_every_time_costs_its_neighbours_nothing(pipeline: Pipeline) -> None:
    pipeline.submit(spec(xs=4, ys=1))
    pipeline.loop.tick(everything=True)
    layers = [ready for ready in pipeline.broker.ready if ready.kind is ProductKind.LAYER]
    digests = [layer.digest for layer in layers]
    route = layers[0].route

    class Maker:
        def make(self, job: Job) -> Finished:
            if job.digest == digests[2]:
                raise KeyboardInterrupt  # nothing of the process goes on
            return Finished(job.digest, bytes=1, pixels=1, cpu_seconds=0.0)

    for _ in range(20 * pipeline.settings.max_attempts):
        try:
            serve_queue(pipeline.context, Maker(), route)
        except KeyboardInterrupt:
            # Redelivered at once, the message meets products that the dead process still holds; then their leases end.
            serve_queue(pipeline.context, Maker(), route)
            with writing(pipeline.context.engine) as connection:
                attempts = pipeline.settings.max_attempts
                sweeping.take_back_expired(connection, now=1e12, max_attempts=attempts)
    states = {product.digest: product.state for product in pipeline.products()}
    assert states.pop(digests[2]) == "failed"
    assert {states[digest] for digest in digests if digest in states} == {"done"}
