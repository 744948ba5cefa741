"""Quotas of owners: what counts, and that no way leads around them. The operator has none."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

import pytest
from sqlalchemy import select

from tests.world.blank import SMALL, Pipeline
from valerie.db import runs
from valerie.db.engine import database_moment, reading
from valerie.db.models import Product
from valerie.errors import Conflict
from valerie.pipeline.control import lifecycle
from valerie.runs.products.states import ProductState

Make = Callable[..., Pipeline]


def test_a_run_too_many_is_refused_with_quota_value_and_limit(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=2)
    for _ in range(2):
        pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="Eve would have 3 unfinished runs; limit: 2"):
        pipeline.submit(owner="Eve")
    pipeline.submit(owner="Ada")
    for _ in range(3):
        pipeline.submit()


def test_variants_of_unfinished_runs_are_counted_before_any_is_written(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_variants=20)
    pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="Eve would have 24 variants in unfinished runs; limit: 20"):
        pipeline.submit(owner="Eve")
    assert pipeline.row(pipeline.submit(owner="Ada")).next_index == 0


def test_a_finished_run_makes_room(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=1)
    assert pipeline.run(pipeline.submit(owner="Eve")) == "completed"
    pipeline.submit(owner="Eve")


@pytest.mark.parametrize("again", [lifecycle.resume, lifecycle.retry])
def test_a_cancelled_run_makes_room_but_cannot_come_back_beside_its_successor(
    pipelines: Make, again: Callable[..., None]
) -> None:
    pipeline = pipelines(max_owner_runs=1)
    first = pipeline.submit(owner="Eve")
    lifecycle.cancel(pipeline.context, first)
    second = pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="2 unfinished runs; limit: 1"):
        again(pipeline.context, first)
    assert pipeline.state(first) == "cancelled"
    lifecycle.cancel(pipeline.context, second)
    again(pipeline.context, first)
    assert pipeline.run(first) == "completed"


def test_what_runs_took_and_store_leaves_no_room_for_another(pipelines: Make) -> None:
    """Equal runs of both owners share their products, which count for each in full and once."""
    pipeline = pipelines()
    first, again = (pipeline.submit(owner="Eve") for _ in range(2))
    assert pipeline.run(first) == pipeline.run(again) == pipeline.run(pipeline.submit(owner="Ada")) == "completed"
    with reading(pipeline.context.engine) as connection:
        made = runs.made(connection, owner="Eve")
        assert made == runs.made(connection, owner="Ada") == runs.made(connection)
        linked = runs.linked_digests(connection, first, list(ProductState))
        sizes = {digest: size for digest, size in connection.execute(select(Product.digest, Product.bytes))}  # noqa: C416  # mypy reads the types of rows
        seconds = sum(runs.cpu_seconds(connection, again).values())
        later = database_moment(connection) + timedelta(seconds=1)
        assert runs.made(connection, owner="Eve", since=later) == (0.0, 0)
    assert made.cpu_seconds == pytest.approx(seconds)
    assert made.bytes == sum(sizes[digest] or 0 for digest in linked) > 0

    hours, gigabytes = made.cpu_seconds / 3600, made.bytes / 1e9
    took = pipelines(max_owner_cpu_hours=hours)
    with pytest.raises(Conflict, match=r"runs of Eve took [\d.]+ CPU hours in 30 days; limit: "):
        took.submit(owner="Eve")
    pipelines(max_owner_cpu_hours=2 * hours).submit(owner="Eve")
    full = pipelines(max_owner_gigabytes=gigabytes)
    with pytest.raises(Conflict, match=r"runs of Ada store [\d.]+ GB; limit: .*delete runs"):
        full.submit(owner="Ada")
    full.submit()
    full.submit(owner="Joe")


def test_a_repeated_request_is_answered_though_the_quota_is_used_up(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=1)
    first = pipeline.submit(owner="Eve", idempotency_key="once")
    assert pipeline.submit(owner="Eve", idempotency_key="once") == first
    with pytest.raises(Conflict, match="another spec"):
        pipeline.submit({**SMALL, "seed": 7}, owner="Eve", idempotency_key="once")
