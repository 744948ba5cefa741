"""Limits on the rate of requests."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.api import rates
from services.api.app import create_app
from services.api.rates import RateLimit
from tests.world.serving import served
from tests.world.world import settings_of

TOKEN = "correct-horse-battery"


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [1000.0]
    monkeypatch.setattr(rates, "monotonic", lambda: now[0])
    return now


def test_a_minutes_requests_may_come_at_once_and_later_ones_as_the_rate_allows(clock: list[float]) -> None:
    limit = RateLimit(30)
    assert [limit.wait_for("ada") for _ in range(31)] == [0] * 30 + [2]
    clock[0] += 2.0
    assert [limit.wait_for("ada") for _ in range(2)] == [0, 2]
    clock[0] += 3600.0
    assert [limit.wait_for("ada") for _ in range(31)] == [0] * 30 + [2]


def test_each_caller_has_a_rate_of_its_own(clock: list[float]) -> None:
    limit = RateLimit(1)
    assert [limit.wait_for(name) for name in ("ada", "bob", "ada")] == [0, 0, 60]


def test_without_a_limit_nobody_waits(clock: list[float]) -> None:
    limit = RateLimit(0)
    assert {limit.wait_for("ada") for _ in range(1000)} == {0}


def test_a_caller_above_its_rate_is_told_when_to_come_again_and_others_are_served(
    tmp_path: Path, clock: list[float]
) -> None:
    settings = settings_of(tmp_path, api_token=TOKEN, requests_per_minute=6)
    with served(create_app(settings, control=False), token=TOKEN) as client:
        guesses = [client.get("/v1/runs", headers={"Authorization": f"Bearer {n}"}) for n in range(20)]
        assert {answer.status_code for answer in guesses} == {401, 429}
        assert guesses[-1].headers["Retry-After"] == "10"
        assert "again in 10 s" in guesses[-1].json()["detail"]
        assert client.get("/v1/runs").status_code == 200
