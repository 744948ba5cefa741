"""`valerie archive`: by id, by age, and back."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from valerie.cli.main import app


def test_a_run_is_archived_shown_as_such_and_comes_back(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path
) -> None:
    folder, run = deployed
    data = ["--data-dir", str(shutil.copytree(folder / "data", tmp_path / "data"))]

    def status() -> dict[str, object]:
        document: dict[str, object] = json.loads(invoke.invoke(app, ["status", "--json", *data]).stdout)
        return document

    rows = invoke.invoke(app, ["rows", run, *data]).stdout
    none = invoke.invoke(app, ["archive", "--older-than", "1", *data])
    assert (none.exit_code, none.stdout) == (0, "")
    archived = invoke.invoke(app, ["archive", "--older-than", "0", *data])
    assert archived.exit_code == 0, archived.output
    assert archived.stdout.startswith(f"archived run {run}: ")
    assert status()["archived"] is True
    assert "archived" in invoke.invoke(app, ["status", *data]).output
    assert invoke.invoke(app, ["rows", run, *data]).stdout == rows
    back = invoke.invoke(app, ["archive", run, "--undo", *data])
    assert back.stdout == f"run {run} is not archived\n"
    assert status()["archived"] is False
    assert invoke.invoke(app, ["rows", run, *data]).stdout == rows


@pytest.mark.parametrize("named", [[], ["r1", "--older-than", "3"], ["--undo"], ["--undo", "--older-than", "3"]])
def test_runs_are_named_or_old(invoke: CliRunner, deployed: tuple[Path, str], named: list[str]) -> None:
    result = invoke.invoke(app, ["archive", *named, "--data-dir", str(deployed[0] / "data")])
    assert "name the runs, or say how old they are" in str(result.exception)
