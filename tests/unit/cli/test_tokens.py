"""`valerie token`: secrets that a server accepts."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner

from services.api.app import create_app
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.cli.main import app
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.errors import InvalidInput


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


def test_an_unknown_role_is_refused_by_name(folder: Path) -> None:
    arguments = ["token", "create", "x", "--owner", "Ada", "--role", "king", "--data-dir", str(folder)]
    error = CliRunner().invoke(app, arguments).exception
    assert isinstance(error, InvalidInput)
    assert "role" in str(error)
    assert "king" in str(error)
