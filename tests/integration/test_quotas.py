"""Requests at the same moment share a quota, on both databases."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import write_box_street
from valerie.access import Role
from valerie.errors import Conflict
from valerie.pipeline.control.tokens import TokenRequest, issue

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.mark.parametrize("database", ["sqlite", "postgres"])
def test_of_many_requests_at_once_only_those_within_the_quota_are_accepted(
    new_database: Callable[[], str], tmp_path: Path, database: str
) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    url = {"database_url": new_database()} if database == "postgres" else {}
    pipeline = Pipeline(tmp_path / "data", tmp_path / "assets", max_owner_runs=3, **url)
    for name in ("day", "night"):
        issue(pipeline.context, TokenRequest(name=name, owner="Eve", role=Role.RUNNER))

    def accepted(_: int) -> bool:
        try:
            pipeline.submit(owner="Eve")
        except Conflict:
            return False
        return True

    with ThreadPoolExecutor(8) as threads:
        assert sum(threads.map(accepted, range(24))) == 3
    pipeline.context.engine.dispose()
