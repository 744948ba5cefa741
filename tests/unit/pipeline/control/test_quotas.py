"""Quotas of owners: what counts, and that no way leads around them. The operator has none."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.world.blank import SMALL, Pipeline
from valerie.errors import Conflict
from valerie.pipeline.control import lifecycle

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


def test_a_repeated_request_is_answered_though_the_quota_is_used_up(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=1)
    first = pipeline.submit(owner="Eve", idempotency_key="once")
    assert pipeline.submit(owner="Eve", idempotency_key="once") == first
    with pytest.raises(Conflict, match="another spec"):
        pipeline.submit({**SMALL, "seed": 7}, owner="Eve", idempotency_key="once")
