"""The audit log: what it holds, and that nobody changes it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import httpx
import pytest
from sqlalchemy import Connection
from typer.testing import CliRunner

from services.api import audit as api_audit
from services.api.app import create_app
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.db import audit
from valerie.errors import StorageFull

TOKEN = "correct-horse-battery"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[httpx.Client]:
    with served(create_app(settings_of(tmp_path, api_token=TOKEN), control=False), token=TOKEN) as client:
        yield client


def rows(client: httpx.Client, **query: int) -> list[dict[str, Any]]:
    answer = client.get("/v1/audit", params=query)
    assert answer.status_code == 200, answer.text
    entries: list[dict[str, Any]] = answer.json()
    return entries


def issued(client: httpx.Client, name: str, role: str) -> dict[str, str]:
    answer = client.post("/v1/tokens", json={"name": name, "owner": "Ada Lovelace", "role": role})
    return {"Authorization": f"Bearer {answer.json()['secret']}"}


def test_each_change_has_a_row_before_it_and_one_with_its_outcome(server: httpx.Client) -> None:
    runner = issued(server, "nightly", "runner")
    assert server.delete("/v1/runs/r0", headers=runner).status_code == 404
    before, after = rows(server)[-2:]
    assert (before["status"], after["status"]) == (None, 404)
    assert after["number"] == before["number"] + 1
    for row in (before, after):
        assert (row["caller"], row["owner"], row["role"]) == ("nightly", "Ada Lovelace", "runner")
        assert (row["method"], row["path"], row["request"]) == ("DELETE", "/v1/runs/r0", before["request"])
    assert {row["caller"] for row in rows(server) if row["path"] == "/v1/tokens"} == {"OPERATOR"}


def test_a_caller_that_has_its_answer_finds_the_outcome_in_the_log(
    server: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    append = audit.append

    def slow(connection: Connection, entry: audit.Entry) -> None:
        if entry.status is not None:
            sleep(0.2)
        append(connection, entry)

    monkeypatch.setattr(audit, "append", slow)
    issued(server, "nightly", "runner")
    assert [row["status"] for row in rows(server)] == [None, 201]
    server.get("/v1/runs", headers={"Authorization": "Bearer valerie_guess"})
    assert [row["status"] for row in rows(server)] == [None, 201, 401]


def test_what_only_reads_or_computes_leaves_no_row(server: httpx.Client) -> None:
    assert server.get("/v1/runs").status_code == 200
    server.post("/v1/plan", content=b"asset: urban-street")
    assert rows(server) == []


def test_refusals_are_kept_with_their_caller_if_it_is_known(server: httpx.Client) -> None:
    viewer = issued(server, "reader", "viewer")
    assert server.get("/v1/audit", headers=viewer).status_code == 403
    assert server.get("/v1/runs", headers={"Authorization": "Bearer valerie_guess"}).status_code == 401
    assert [(row["caller"], row["path"], row["status"]) for row in rows(server)[-2:]] == [
        ("reader", "/v1/audit", 403),
        (None, "/v1/runs", 401),
    ]


def test_a_flood_of_refusals_is_counted_and_not_kept(server: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [1000.0]
    monkeypatch.setattr(api_audit, "monotonic", lambda: clock[0])
    stranger = {"Authorization": "Bearer no"}
    for _ in range(api_audit.KEPT_PER_MINUTE + 7):
        server.get("/v1/runs", headers=stranger)
    assert len(rows(server)) == api_audit.KEPT_PER_MINUTE
    clock[0] += 60.0
    server.get("/v1/runs", headers=stranger)
    assert rows(server)[-1]["left_out"] == 7


def test_no_secret_is_in_the_log(server: httpx.Client) -> None:
    secret = issued(server, "nightly", "runner")["Authorization"].removeprefix("Bearer ")
    server.delete("/v1/tokens/nightly")
    assert secret not in str(rows(server))
    assert TOKEN not in str(rows(server))


@pytest.mark.parametrize("statement", ["UPDATE audit SET caller = 'x'", "DELETE FROM audit"])
def test_not_even_the_database_lets_a_row_be_changed(server: httpx.Client, tmp_path: Path, statement: str) -> None:
    issued(server, "nightly", "runner")
    connection = sqlite3.connect(tmp_path / "valerie.sqlite3")
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        connection.execute(statement)
    connection.close()
    assert len(rows(server)) == 2


def test_a_change_that_cannot_be_recorded_is_not_made(server: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_connection: object, _entry: object) -> None:
        raise StorageFull("the disk is full")

    monkeypatch.setattr(audit, "append", full)
    answer = server.post("/v1/tokens", json={"name": "nightly", "owner": "Ada", "role": "admin"})
    assert (answer.status_code, answer.json()["detail"]) == (503, "the disk is full")
    assert server.get("/v1/tokens").json() == []


def test_the_log_is_read_in_pages_and_printed_by_the_command(server: httpx.Client, tmp_path: Path) -> None:
    issued(server, "nightly", "runner")
    issued(server, "weekly", "viewer")
    first = rows(server, limit=3)
    rest = rows(server, after=first[-1]["number"])
    assert [row["number"] for row in (*first, *rest)] == [1, 2, 3, 4]
    shown = CliRunner().invoke(app, ["audit", "--data-dir", str(tmp_path)])
    assert shown.exit_code == 0, shown.output
    assert "201 OPERATOR from 127.0.0.1: POST /v1/tokens" in shown.stdout
    lines = CliRunner().invoke(app, ["audit", "--json", "--data-dir", str(tmp_path)]).stdout.splitlines()
    assert len(lines) == 4
