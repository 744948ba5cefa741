"""Deliveries of webhooks on Postgres."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest

from tests.world.blank import Pipeline
from valerie.db import deliveries
from valerie.db.deliveries import RunEnding
from valerie.db.engine import reading, writing
from valerie.pipeline.control import lifecycle

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

NOW = 1_000.0


def due(pipeline: Pipeline, now: float = NOW) -> list[RunEnding]:
    with reading(pipeline.context.engine) as connection:
        since = datetime.now(UTC) - timedelta(days=1)
        return deliveries.due(connection, "receiver", since=since, now=now, limit=10)


def test_an_ending_is_due_until_it_is_delivered(pipeline: Pipeline) -> None:
    run = pipeline.submit(owner="Ada")
    assert due(pipeline) == []
    lifecycle.cancel(pipeline.context, run)
    (ending,) = due(pipeline)
    assert (ending.id, ending.owner, ending.attempts) == (run, "Ada", 0)
    with writing(pipeline.context.engine) as connection:
        deliveries.note(connection, ending, "receiver", due_at=NOW + 5, problem="no answer")
    assert due(pipeline) == []
    (again,) = due(pipeline, NOW + 5)
    assert again.attempts == 1
    with writing(pipeline.context.engine) as connection:
        deliveries.note(connection, again, "receiver", due_at=None)
    assert due(pipeline, NOW + 86_400) == []


def test_a_run_that_is_deleted_meanwhile_leaves_no_row(pipeline: Pipeline) -> None:
    run = pipeline.submit()
    lifecycle.cancel(pipeline.context, run)
    (ending,) = due(pipeline)
    lifecycle.delete(pipeline.context, run)
    with writing(pipeline.context.engine) as connection:
        deliveries.note(connection, ending, "receiver", due_at=NOW, problem="no answer")
    with reading(pipeline.context.engine) as connection:
        assert deliveries.problems(connection, "receiver", since=datetime.fromtimestamp(0, UTC)) == []
