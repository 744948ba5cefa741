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
    with pytest.raises(
        ServerUnavailableError, match=r"nobody, which does not exist; start one with `.* up --data-dir .*nobody"
    ) as raised:
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


@pytest.mark.parametrize("command", [["status"], ["report", "r1"], ["study", "status"], ["study", "report", "s1"]])
def test_a_configured_address_is_asked_also_where_the_folder_could_answer(
    command: list[str], invoke: CliRunner, deployed: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VALERIE_API_PORT", "9")  # the discard service: no server of VALERIE has it
    result = invoke.invoke(app, [*command, "--data-dir", str(deployed[0] / "data")])
    assert isinstance(result.exception, ServerUnavailableError)
    assert "http://127.0.0.1:9" in str(result.exception)


def test_the_data_folder_answers_for_its_studies(invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path) -> None:
    data = ["--data-dir", str(deployed[0] / "data")]
    assert "no studies yet" in invoke.invoke(app, ["study", "status", *data], catch_exceptions=False).stderr
    for command in (["status", "s1"], ["report", "s1", "--output", str(tmp_path / "s.html")]):
        with pytest.raises(NotFound, match="no study s1"):
            invoke.invoke(app, ["study", *command, *data], catch_exceptions=False)
