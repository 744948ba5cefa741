"""Requests at the same moment share a quota, on both databases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import write_box_street
from valerie.access import Role
from valerie.errors import Conflict
from valerie.pipeline.control.tokens import TokenRequest, issue

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture(params=["sqlite", "postgres"])
def pipeline(request: pytest.FixtureRequest, new_database: Callable[[], str], tmp_path: Path) -> Iterator[Pipeline]:
    """Pipeline with two tokens of Eve, who may have three unfinished runs."""
    write_box_street(tmp_path / "assets" / "box-street")
    url = {"database_url": new_database()} if request.param == "postgres" else {}
    pipeline = Pipeline(tmp_path / "data", tmp_path / "assets", max_owner_runs=3, **url)
    for name in ("day", "night"):
        issue(pipeline.context, TokenRequest(name=name, owner="Eve", role=Role.RUNNER))
    yield pipeline
    pipeline.context.engine.dispose()


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
