"""Exporting, evaluating and comparing from the command line, over a run of the blank engine."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from valerie.cli.datasets import parse_splits
from valerie.cli.main import app
from valerie.cli.progress_lines import ProgressLines
from valerie.errors import Conflict, InvalidInput, UnknownName


def test_a_run_is_exported_and_evaluated_beside_itself(
    deployed: tuple[Path, str], invoke: CliRunner, tmp_path: Path
) -> None:
    folder, run_id = deployed
    data = ["--data-dir", str(folder / "data")]
    out = tmp_path / "set"
    export = [
        "dataset",
        "export",
        run_id,
        "--out",
        str(out),
        "--format",
        "cityscapes",
        "--where",
        "camera == 'camera-1'",
    ]
    done = invoke.invoke(app, [*export, *data])
    assert done.exit_code == 0, done.output
    assert "12 val; 12 finished frames do not meet the expression" in done.stdout
    evaluate = [
        "evaluate",
        "--dataset",
        str(out),
        "--function",
        "blank",
        "--beside",
        run_id,
        "--out",
        str(tmp_path / "o"),
    ]
    shown = invoke.invoke(app, [*evaluate, *data])
    assert shown.exit_code == 0, shown.output
    assert f"blank, run {run_id}" in shown.stdout
    assert "12 of 12" in shown.stdout
    assert "Run as blank." in shown.stdout
    printed = invoke.invoke(app, [*evaluate, *data, "--json"])
    document = json.loads(printed.stdout)
    assert document["functions"]["blank"]["frames"] == 12
    assert document["beside"]["blank"]["frames"] == 24
    assert json.loads((tmp_path / "o" / "evaluation.json").read_text())["digest"] == document["digest"]


def test_unknown_formats_and_splits_are_refused(deployed: tuple[Path, str], invoke: CliRunner, tmp_path: Path) -> None:
    _, run_id = deployed
    wrong = invoke.invoke(app, ["dataset", "export", run_id, "--out", str(tmp_path / "x"), "--format", "cityscape"])
    assert isinstance(wrong.exception, UnknownName)
    assert "cityscapes" in str(wrong.exception)
    for text in ("train=0.8,val=x", "train=0.8,val"):
        with pytest.raises(InvalidInput, match="--split"):
            parse_splits(text)
    assert parse_splits("val") == {"val": 1.0}
    assert parse_splits("train=0.75, val=0.25") == {"train": 0.75, "val": 0.25}


def test_training_against_a_weakness_says_what_is_missing(
    deployed: tuple[Path, str], invoke: CliRunner, tmp_path: Path
) -> None:
    folder, run_id = deployed
    begin = ["train", "--from", run_id, "--data-dir", str(folder / "data")]
    for more, match in (
        ([], "--where"),
        (["--where", "pacc < 1", "--out", str(tmp_path / "x.onnx")], "not the name of a function file"),
        (["--where", "pacc < 1", "--out", str(tmp_path / "x.safetensors")], "fresh sites"),
        (["--where", "pacc < 1"], "fresh sites"),
    ):
        problem = invoke.invoke(app, [*begin, *more]).exception
        assert isinstance(problem, InvalidInput)
        assert match in str(problem)
    (tmp_path / "there.safetensors").write_bytes(b"kept")
    there = ["--where", "pacc < 1", "--out", str(tmp_path / "there.safetensors")]
    assert "never overwritten" in str(invoke.invoke(app, [*begin, *there]).exception)
    assert "Usage" in invoke.invoke(app, ["train"]).stdout


def test_versions_that_run_unlike_are_compared_only_when_that_is_asked_for(
    deployed: tuple[Path, str], invoke: CliRunner
) -> None:
    folder, run_id = deployed
    versions = ["--version", "blank", "--version", "semantic-fpn-small", "--threads", "1"]
    compare = ["train", "compare", run_id, *versions, "--data-dir", str(folder / "data"), "--json"]
    refused = invoke.invoke(app, compare).exception
    assert isinstance(refused, Conflict)
    assert "blank ran as blank; semantic-fpn-small runs here as openvino-" in str(refused)
    assert "--mixed" in str(refused)
    shown = invoke.invoke(app, [*compare, "--mixed"])
    assert shown.exit_code == 0, shown.output
    first, second = json.loads(shown.stdout)["numeric_classes"]
    assert first == "blank"
    assert second.startswith("openvino-")


def test_progress_says_how_many_how_fast_and_how_long(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = ProgressLines("frames")
    lines.tell(1, 10, 2.0)  # too early for a line
    later = time.monotonic() + 60
    monkeypatch.setattr(time, "monotonic", lambda: later)
    lines.tell(4, 10, 2.0, "note")
    lines.tell(10, 10, 0.5)
    assert capsys.readouterr().err.splitlines() == [
        "4 of 10 frames (note), 2.0/s, 3 s left",
        "10 of 10 frames, 2.0 s each",
    ]
