"""`valerie token`: secrets that a server accepts."""

from __future__ import annotations

import json
import socket
import subprocess
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.boxes import spec, write_box_street
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.errors import InvalidInput, NotFound


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    engine = open_database(settings_of(tmp_path).database_url)
    migrate(engine)
    engine.dispose()
    return tmp_path


def call(folder: Path, *arguments: str) -> str:
    result = CliRunner().invoke(app, ["token", *arguments, "--data-dir", str(folder)])
    assert result.exit_code == 0, result.output
    return result.stdout.strip()


def test_a_server_accepts_a_secret_until_it_is_revoked(folder: Path) -> None:
    secret = call(folder, "create", "nightly", "--owner", "Ada", "--role", "runner")
    server = create_app(settings_of(folder, api_token="correct-horse-battery"), control=False)
    with served(server, token=secret) as client:
        assert client.get("/v1/runs").status_code == 200
        call(folder, "revoke", "nightly")
        assert client.get("/v1/runs").status_code == httpx.codes.UNAUTHORIZED


def test_tokens_are_listed_without_their_secrets(folder: Path) -> None:
    secret = call(folder, "create", "nightly", "--owner", "Ada Lovelace")
    shown = call(folder, "list")
    assert shown.split()[:2] == ["nightly", "viewer"]
    assert shown.endswith("never used: Ada Lovelace")
    listed = call(folder, "list", "--json")
    assert json.loads(listed)["owner"] == "Ada Lovelace"
    assert secret.removeprefix("valerie_") not in shown + listed


def test_commands_that_change_tokens_leave_rows_of_the_systems_user_and_host(folder: Path) -> None:
    secret = call(folder, "create", "nightly", "--owner", "Ada")
    call(folder, "list")
    with pytest.raises(NotFound):
        CliRunner().invoke(app, ["token", "revoke", "no", "--data-dir", str(folder)], catch_exceptions=False)
    call(folder, "revoke", "nightly")
    log = CliRunner().invoke(app, ["audit", "--json", "--data-dir", str(folder)]).stdout
    rows = [json.loads(line) for line in log.splitlines()]
    assert [(row["path"], row["status"]) for row in rows] == [
        ("valerie token create nightly", None),
        ("valerie token create nightly", 0),
        ("valerie token revoke no", None),
        ("valerie token revoke no", 2),
        ("valerie token revoke nightly", None),
        ("valerie token revoke nightly", 0),
    ]
    actors = {(row["caller"], row["owner"], row["address"], row["role"]) for row in rows}
    user = subprocess.run(["id", "--user", "--name"], capture_output=True, text=True, check=True).stdout.strip()
    assert actors == {("COMMAND", user, socket.gethostname(), None)}
    assert secret.removeprefix("valerie_") not in log
    shown = CliRunner().invoke(app, ["audit", "--data-dir", str(folder)]).stdout
    assert f"{user} from {socket.gethostname()}: COMMAND valerie token create nightly" in shown


def test_an_unknown_role_is_refused_by_name(folder: Path) -> None:
    arguments = ["token", "create", "x", "--owner", "Ada", "--role", "king", "--data-dir", str(folder)]
    error = CliRunner().invoke(app, arguments).exception
    assert isinstance(error, InvalidInput)
    assert "role" in str(error)
    assert "king" in str(error)


def test_quotas_are_shown_by_a_server_to_their_holder_and_from_the_folder_to_the_operator(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def quota(*arguments: str) -> str:
        result = CliRunner().invoke(app, ["quota", *arguments, "--data-dir", str(folder)])
        assert result.exit_code == 0, result.output
        return result.stdout

    assert quota() == ""
    eve = call(folder, "create", "eve", "--owner", "Eve", "--role", "runner")
    write_box_street(folder / "assets" / "box-street")
    limits = {"max_owner_runs": 9, "max_owner_cpu_hours": 1.5}
    settings = settings_of(folder, api_token="correct-horse-battery", testing_engines=True, **limits)
    with served(create_app(settings, control=False), token=eve) as client:
        assert client.post("/v1/runs", json=spec(xs=2, ys=2)).status_code == httpx.codes.ACCEPTED
        monkeypatch.setenv("VALERIE_API_TOKEN", eve)
        runs, hours = json.loads(quota("--url", str(client.base_url), "--json"))
        lines = quota("--url", str(client.base_url)).splitlines()
    assert (runs["holder"], runs["resource"], runs["used"], runs["limit"]) == ("Eve", "runs", 1, 9)
    assert (hours["resource"], hours["used"], hours["limit"]) == ("cpu-hours", 0, 1.5)
    assert hours["forecast"] > 0
    assert [line.split()[:5] for line in lines] == [
        ["Eve", "runs", "1", "of", "9"],
        ["Eve", "cpu-hours", "0.00", "of", "1.50,"],
    ]
    monkeypatch.setenv("VALERIE_MAX_OWNER_RUNS", "9")
    assert quota().split() == ["Eve", "runs", "1", "of", "9"]
