"""Quotas of the owners of tokens, at the API."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from services.api.app import create_app
from tests.world.boxes import spec, write_box_street
from tests.world.serving import served
from tests.world.world import settings_of

TOKEN = "correct-horse-battery"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[httpx.Client]:
    write_box_street(tmp_path / "assets" / "box-street")
    settings = settings_of(
        tmp_path, api_token=TOKEN, asset_dir=tmp_path / "assets", testing_engines=True, max_owner_runs=1
    )
    with served(create_app(settings, control=False), token=TOKEN) as client:
        yield client


def submit(server: httpx.Client, secret: str) -> httpx.Response:
    return server.post("/v1/runs", json=spec(xs=2, ys=2), headers={"Authorization": f"Bearer {secret}"})


def issued(server: httpx.Client, name: str, owner: str) -> str:
    answer = server.post("/v1/tokens", json={"name": name, "owner": owner, "role": "runner"})
    secret: str = answer.json()["secret"]
    return secret


def test_a_second_token_of_an_owner_brings_no_second_quota(server: httpx.Client) -> None:
    day, night, other = issued(server, "day", "Eve"), issued(server, "night", "Eve"), issued(server, "ada", "Ada")
    first = submit(server, day)
    assert first.status_code == 202
    refusal = submit(server, night)
    assert (refusal.status_code, refusal.json()["detail"]) == (
        409,
        "Eve would have 2 unfinished runs; limit: 1",
    )
    assert [run["id"] for run in server.get("/v1/runs").json()["items"]] == [first.json()["id"]]
    assert submit(server, other).status_code == 202
    assert submit(server, TOKEN).status_code == 202


def test_a_run_resumed_by_another_person_counts_for_its_owner(server: httpx.Client) -> None:
    eve, ada = issued(server, "eve", "Eve"), issued(server, "ada", "Ada")
    run = submit(server, eve).json()["id"]
    headers = {"Authorization": f"Bearer {ada}"}
    assert server.post(f"/v1/runs/{run}/cancel", headers=headers).status_code == 200
    assert submit(server, eve).status_code == 202
    assert server.post(f"/v1/runs/{run}/resume", headers=headers).status_code == 409


def test_a_caller_reads_its_own_quotas_and_the_operator_all(server: httpx.Client) -> None:
    eve, ada = issued(server, "eve", "Eve"), issued(server, "ada", "Ada")
    for secret in (eve, ada):
        submit(server, secret)

    def holders(secret: str) -> list[str]:
        answer = server.get("/v1/quotas", headers={"Authorization": f"Bearer {secret}"}).json()
        assert all((quota["used"], quota["forecast"], quota["limit"]) == (1, 0, 1) for quota in answer)
        return [f"{quota['holder']}: {quota['resource']}" for quota in answer]

    assert holders(eve) == ["Eve: runs"]
    assert holders(ada) == ["Ada: runs"]
    assert holders(TOKEN) == ["Ada: runs", "Eve: runs"]
