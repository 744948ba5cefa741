"""`valerie slurm submit`: the commands that it would call."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from valerie.cli.main import app
from valerie.errors import InvalidInput


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> CliRunner:
    monkeypatch.setenv("VALERIE_DATABASE_URL", "postgresql://h/d")
    monkeypatch.setenv("VALERIE_DATA_DIR", str(tmp_path))
    return CliRunner()


def lines(runner: CliRunner, *arguments: str) -> list[str]:
    done = runner.invoke(app, ["slurm", "submit", "--show", *arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output.splitlines()


def test_each_stage_is_an_array_of_its_workers(shown: CliRunner) -> None:
    render, infer = lines(shown, "--render", "3", "--infer", "1", "--eval", "0")
    assert "--array=1-3" in render
    assert "services.render_worker" in render
    assert "--array=1-1" in infer
    assert "services.infer_worker" in infer


def test_an_option_with_a_stage_is_for_this_stage_only(shown: CliRunner) -> None:
    render, infer, evaluate = lines(shown, "--sbatch", "time=04:00:00", "--sbatch", "infer:gres=gpu:1")
    assert [line.count("--time=04:00:00") for line in (render, infer, evaluate)] == [1, 1, 1]
    assert [line.count("--gres=gpu:1") for line in (render, infer, evaluate)] == [0, 1, 0]


@pytest.mark.parametrize("option", ["; rm", "--time=1", "infer:", "TIME=1"])
def test_what_is_no_option_is_refused(shown: CliRunner, option: str) -> None:
    with pytest.raises(InvalidInput, match="--sbatch: not an option"):
        lines(shown, "--sbatch", option)


def test_nodes_cannot_share_sqlite(shown: CliRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VALERIE_DATABASE_URL")
    with pytest.raises(InvalidInput, match="VALERIE_DATABASE_URL"):
        lines(shown)
