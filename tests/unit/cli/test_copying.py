"""`valerie copy`: a run into a data folder, and from there into a deployment."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from valerie.cli.main import app


def listed(invoke: CliRunner, folder: Path) -> list[str]:
    lines = invoke.invoke(app, ["status", "--json", "--data-dir", str(folder)]).stdout.splitlines()
    return [json.loads(line)["id"] for line in lines]


def test_a_run_goes_into_a_folder_and_from_there_into_a_deployment_that_was_empty(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path
) -> None:
    folder, run = deployed
    away, home = tmp_path / "away", tmp_path / "home"
    there = invoke.invoke(app, ["copy", run, "--to", str(away), "--data-dir", str(folder / "data"), "--json"])
    assert there.exit_code == 0, there.output
    assert json.loads(there.stdout)["objects"] > 0
    back = invoke.invoke(app, ["copy", run, "--from", str(away), "--data-dir", str(home)])
    assert back.exit_code == 0, back.output
    assert f"copied run {run}" in back.stdout
    assert listed(invoke, away) == listed(invoke, home) == [run]


@pytest.mark.parametrize("sides", [[], ["--to", "a", "--from", "b"]])
def test_a_copy_has_one_direction(invoke: CliRunner, deployed: tuple[Path, str], sides: list[str]) -> None:
    result = invoke.invoke(app, ["copy", deployed[1], *sides])
    assert "one of both" in str(result.exception)


def test_a_folder_without_a_database_is_named_and_nothing_is_created(invoke: CliRunner, tmp_path: Path) -> None:
    result = invoke.invoke(app, ["copy", "x", "--from", str(tmp_path / "no"), "--data-dir", str(tmp_path / "data")])
    assert "not a data folder" in str(result.exception)
    assert list(tmp_path.iterdir()) == []
