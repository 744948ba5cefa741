"""Queries about products whose wording differs between SQLite and Postgres, on Postgres."""

from __future__ import annotations

import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import accumulate
from typing import Any

import pytest
from sqlalchemy import Engine, select, text

from tests.integration.waiting import wait_for_locks
from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import claiming, products, publishing, sweeping, totals
from valerie.db.engine import database_time, writing
from valerie.db.measured import SeenPerson
from valerie.db.models import Product
from valerie.db.products import Wanted
from valerie.db.publishing import Finished
from valerie.pipeline.control import lifecycle
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind, ProductState
from valerie.runs.products.turns import Turns, packet_size

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


def digest(name: str) -> str:
    return name.ljust(32, "0")


NO = Fault(stage=ProductKind.LAYER, type="RenderingError", message="no", attempts=1)
WANTED: list[Wanted] = [
    Wanted(digest("b"), ProductKind.BACKGROUND, "render", "g"),
    Wanted(digest("l"), ProductKind.LAYER, "render", "g"),
    Wanted(digest("p"), ProductKind.PREDICTION, "infer", "g", digest("l"), digest("b")),
]


def finish(engine: Engine, *names: str) -> list[str]:
    """Products claimed and published by a worker; what became ready by that."""
    digests = [digest(name) for name in names]
    with writing(engine) as connection:
        connection.execute(
            Product.__table__.update().where(Product.digest.in_(digests)).values(state="running", lease_owner="w")
        )
        done = [Finished(one, bytes=1, pixels=1, cpu_seconds=0.5) for one in digests]
        publishing.publish(connection, done, owner="w", now=1.0)
    with writing(engine) as connection:
        return [item.digest for item in products.promote_dependents(connection, digests, 2.0)]


def test_wanted_products_become_ready_one_after_the_other(engine: Engine) -> None:
    with writing(engine) as connection:
        assert [item.digest for item in products.want(connection, WANTED, 0.0, Turns())] == [digest("b"), digest("l")]
    assert finish(engine, "l") == []
    assert finish(engine, "b") == [digest("p")]
    with writing(engine) as connection:
        # A run that wants it first gives it an earlier turn, which is announced once.
        assert [item.digest for item in products.want(connection, WANTED, 3.0, Turns())] == [digest("p")]
        assert products.want(connection, WANTED, 4.0, Turns()) == []


def test_what_failed_is_tried_again_where_its_inputs_are_done(engine: Engine) -> None:
    with writing(engine) as connection:
        products.want(connection, WANTED, 0.0, Turns())
    finish(engine, "b", "l")
    with writing(engine) as connection:
        products.fail(connection, digest("p"), owner=None, error=NO, now=1.0)
        assert [item.digest for item in products.want(connection, WANTED, 3.0, Turns())] == [digest("p")]
        row = connection.execute(select(Product).where(Product.digest == digest("p"))).one()
    assert (row.state, row.error, row.sent_at) == ("ready", None, 3.0)


def test_a_failure_is_passed_on_and_counted(engine: Engine) -> None:
    with writing(engine) as connection:
        products.want(connection, WANTED, 0.0, Turns())
    finish(engine, "b")
    with writing(engine) as connection:
        products.fail(connection, digest("l"), owner=None, error=NO, now=1.0)
        ended = {kind: rest for kind, *rest in totals.totals(connection)}
        costs = totals.recorded_costs(connection)
    assert {kind: rest for kind, rest in ended.items() if rest != [0, 0, 0.0]} == {
        "background": [1, 0, 0.5],
        "layer": [0, 1, 0.0],
        "prediction": [0, 1, 0.0],
    }
    assert [(cost.kind, cost.cpu_seconds) for cost in costs] == [("background", 0.5)]


def test_a_product_freed_after_its_lease_was_lost_harms_no_other(engine: Engine) -> None:
    measures = {"pixel_area": 5, "pixel_area_percent": 0.1, "pixel_area_amodal": 5}
    finished = [Finished(digest(name), bytes=1, pixels=1, cpu_seconds=0.5) for name in "bl"]
    finished[1] = replace(finished[1], person_views=(SeenPerson(24001, measures, None, None),))
    with writing(engine) as connection:
        products.want(connection, WANTED[:2], 0.0, Turns())
        connection.execute(Product.__table__.update().values(state="running", lease_owner="w"))
        sweeping.free(connection, [digest("l")])
        assert publishing.publish(connection, finished, owner="w", now=1.0) == [digest("b")]
    with writing(engine) as connection:
        assert connection.execute(select(Product.digest, Product.state)).all() == [(digest("b"), "done")]


def test_the_time_of_leases_is_the_servers(engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.time()
    monkeypatch.setattr(time, "time", lambda: real + 1e6)
    with writing(engine) as connection:
        products.want(connection, WANTED[:1], database_time(connection), Turns())
        sent = connection.scalar(select(Product.sent_at))
        assert abs(sent - real) < 1e5
        sweeping.bound_times(connection, now=sent - 1e5, lease_seconds=60.0)
        assert connection.scalar(select(Product.sent_at)) == pytest.approx(sent - 1e5)


def test_workers_that_claim_at_the_same_time_get_different_packets_and_none_waits(pipeline: Pipeline) -> None:
    engine, _ = pipeline.context.engine, pipeline.submit()
    pipeline.loop.tick(everything=True)
    ready = [product for product in pipeline.products() if product.kind is ProductKind.TRUTH]
    (route,) = {product.route for product in ready}
    with writing(engine) as first, writing(engine) as second:
        second.execute(text("SET LOCAL lock_timeout = '1s'"))
        packets = [
            claiming.claim_next(connection, route, owner=owner, now=1.0, lease_seconds=60.0)
            for connection, owner in ((first, "first"), (second, "second"))
        ]
    taken = [job.digest for packet in packets for job in packet]
    assert all(packets)
    assert len(taken) == len(set(taken))
    owners = {product.digest: product.lease_owner for product in pipeline.products() if product.digest in taken}
    assert owners == {
        job.digest: owner for owner, packet in zip(("first", "second"), packets, strict=True) for job in packet
    }


def test_a_run_that_continues_gets_the_products_that_a_worker_is_parking(pipeline: Pipeline) -> None:
    engine, run = pipeline.context.engine, pipeline.submit(spec(xs=2, ys=1))
    pipeline.loop.tick(everything=True)
    lifecycle.cancel(pipeline.context, run)
    with ThreadPoolExecutor(1) as executor:
        with writing(engine) as connection:
            ready = connection.scalars(select(Product.digest).where(Product.state == ProductState.READY)).all()
            assert ready
            assert not claiming.claim(connection, ready, owner="w", now=1.0, lease_seconds=60.0)
            resumed = executor.submit(lifecycle.resume, pipeline.context, run)
            wait_for_locks(engine, 1)
        resumed.result()
    assert not any(product.state is ProductState.PARKED for product in pipeline.products())
    assert pipeline.run(run) == "completed"


@pytest.mark.parametrize("first", ["the sweep", "the run"])
def test_a_run_that_continues_gets_the_products_that_the_sweep_is_parking(
    pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch, first: str
) -> None:
    engine, run = pipeline.context.engine, pipeline.submit(spec(xs=2, ys=1))
    pipeline.loop.tick(everything=True)
    lifecycle.cancel(pipeline.context, run)
    revive = products.revive

    def sweep() -> None:
        with writing(engine) as connection:
            sweeping.park_unneeded(connection)

    with ThreadPoolExecutor(1) as executor:
        if first == "the sweep":
            with writing(engine) as connection:
                sweeping.park_unneeded(connection)
                other = executor.submit(lifecycle.resume, pipeline.context, run)
                wait_for_locks(engine, 1)
        else:

            def beside(*arguments: Any) -> None:
                waiting.append(executor.submit(sweep))
                wait_for_locks(engine, 1)
                revive(*arguments)

            waiting: list[Future[None]] = []
            monkeypatch.setattr(products, "revive", beside)
            lifecycle.resume(pipeline.context, run)
            (other,) = waiting
        other.result()
    assert not any(product.state is ProductState.PARKED for product in pipeline.products())
    assert pipeline.run(run) == "completed"


def test_workers_that_claim_at_the_same_time_serve_two_owners_equally(pipeline: Pipeline) -> None:
    engine, workers = pipeline.context.engine, 4
    for number in range(5):
        pipeline.submit(spec(xs=12, ys=2, constants={"sun-1.elevation": 10 + number}), owner="many")
    one = pipeline.submit(spec(xs=12, ys=10, constants={"sun-1.elevation": 20}), owner="one")
    pipeline.loop.tick(everything=True)
    route = next(row.route for row in pipeline.products() if row.kind is ProductKind.LAYER)
    taken: list[tuple[float, str, bool]] = []

    def work() -> None:
        while True:
            with writing(engine) as connection:
                jobs = claiming.claim_next(connection, route, owner="w", now=1.0, lease_seconds=1e6)
                moment = database_time(connection)  # a thread may wait long before it can note its jobs
            if not jobs:
                return
            taken.extend((moment, job.digest, job.frame.key.run_id == one) for job in jobs)

    with ThreadPoolExecutor(workers) as executor:
        for future in [executor.submit(work) for _ in range(workers)]:
            future.result()
    assert len({digest for _, digest, _ in taken}) == len(taken) == 5 * (48 + 2) + 240 + 2
    leads = list(accumulate((1 if is_one else -1 for _, _, is_one in sorted(taken)), initial=0))
    # Each worker may choose before it knows what the others took.
    assert max(map(abs, leads)) <= (workers + 1) * packet_size(ProductKind.LAYER)
