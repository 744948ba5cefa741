"""Quotas on both databases; requests at the same moment share one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import write_box_street
from valerie.access import Role
from valerie.db import usage
from valerie.db.engine import reading
from valerie.errors import Conflict
from valerie.pipeline.control import lifecycle
from valerie.pipeline.control.tokens import TokenRequest, issue

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


Open = Callable[..., Pipeline]


@pytest.fixture(params=["sqlite", "postgres"])
def opened(request: pytest.FixtureRequest, new_database: Callable[[], str], tmp_path: Path) -> Iterator[Open]:
    """A function that opens one deployment with different settings."""
    write_box_street(tmp_path / "assets" / "box-street")
    url: dict[str, Any] = {"database_url": new_database()} if request.param == "postgres" else {}
    pipelines: list[Pipeline] = []

    def opened(**settings: Any) -> Pipeline:
        pipelines.append(Pipeline(tmp_path / "data", tmp_path / "assets", **url, **settings))
        return pipelines[-1]

    yield opened
    for pipeline in pipelines:
        pipeline.context.engine.dispose()


@pytest.fixture
def pipeline(opened: Open) -> Pipeline:
    """Pipeline with two tokens of Eve, who may have three unfinished runs."""
    pipeline = opened(max_owner_runs=3)
    for name in ("day", "night"):
        issue(pipeline.context, TokenRequest(name=name, owner="Eve", role=Role.RUNNER))
    return pipeline


def test_of_many_requests_at_once_only_those_within_the_quota_are_accepted(pipeline: Pipeline) -> None:
    def accepted(_: int) -> bool:
        try:
            pipeline.submit(owner="Eve")
        except Conflict:
            return False
        return True

    with ThreadPoolExecutor(8) as threads:
        assert sum(threads.map(accepted, range(24))) == 3


def test_a_request_repeated_at_once_is_accepted_as_one_run_when_it_takes_the_last_room(pipeline: Pipeline) -> None:
    for _ in range(2):
        pipeline.submit(owner="Eve")

    def submit(_: int) -> str:
        return pipeline.submit(owner="Eve", idempotency_key="last")

    with ThreadPoolExecutor(8) as threads:
        assert len(set(threads.map(submit, range(24)))) == 1


def test_a_run_pauses_at_a_quota_and_its_cpu_time_counts_when_it_is_deleted(opened: Open) -> None:
    run = opened().submit(owner="Eve")
    scarce = opened(max_owner_cpu_hours=1e-9)
    assert scarce.run(run, until=["paused"]) == "paused"
    stop = Event()
    stop.set()
    scarce.loop.run(stop)
    raised = opened(max_owner_cpu_hours=1, max_owner_gigabytes=1)
    assert raised.run(run) == "completed"
    twin = raised.submit(owner="Eve")
    assert raised.row(twin).forecast is not None
    assert raised.run(twin) == "completed"

    def seconds() -> float:
        with reading(raised.context.engine) as connection:
            return usage.made(connection, owner="Eve").cpu_seconds

    before = seconds()
    for each in (run, twin):
        lifecycle.delete(raised.context, each)
        assert seconds() == pytest.approx(before)
