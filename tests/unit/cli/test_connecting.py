"""Choice of server and database by a command."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from valerie.cli.connecting import client_of
from valerie.cli.main import app
from valerie.client import ServerUnavailableError
from valerie.errors import NotFound
from valerie.settings import load_settings


def test_a_data_folder_without_a_server_is_not_answered_by_another_folders_server(tmp_path: Path) -> None:
    with pytest.raises(ServerUnavailableError, match=r"start one with `.* up --data-dir .*nobody") as raised:
        client_of(load_settings(data_dir=tmp_path / "nobody"))
    assert "--url" in str(raised.value)


def test_a_named_server_and_a_configured_address_are_asked_whatever_the_folder(tmp_path: Path) -> None:
    assert client_of(load_settings(data_dir=tmp_path), "http://other:1").url == "http://other:1"
    assert client_of(load_settings(data_dir=tmp_path, api_port=8701)).url == "http://127.0.0.1:8701"


@pytest.mark.parametrize("command", [["replay", "r1.0.0.0"], ["gc"], ["dataset", "export", "r1", "--out", "x"]])
def test_reading_where_nothing_ran_makes_no_database(command: list[str], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, [*command, "--data-dir", str(tmp_path / "nobody")])
    assert isinstance(result.exception, NotFound)
    assert "nobody/valerie.sqlite3" in str(result.exception)
    assert list(tmp_path.iterdir()) == []
