"""What `valerie run` says at its end."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from valerie.cli import runs
from valerie.cli.main import app
from valerie.cli.runs import next_step
from valerie.client import Run

SPEC = "name: s\nasset: urban-street\nfunctions: [my-net]\n"


def test_the_next_step_repeats_the_command_with_the_functions_and_the_folder_it_was_given() -> None:
    text = next_step(Path("my spec.yaml"), SPEC.encode(), functions="my-net,other", data_dir=Path("/data here"))
    assert "run 'my spec.yaml' --functions my-net,other --data-dir '/data here'\n" in text
    plain = next_step(Path("s.yaml"), SPEC.encode(), functions=None, data_dir=None)
    assert "add the line  sensors: [{name: day}, {name: dusk, exposure_ev: -2}]  to s.yaml; then" in plain
    assert "run s.yaml\n" in plain


def test_a_spec_with_sensors_gets_one_more_and_not_a_second_list() -> None:
    text = next_step(Path("s.yaml"), f"{SPEC}sensors: [{{name: day}}]\n".encode(), functions=None, data_dir=None)
    assert "add  {name: dusk, exposure_ev: -2}  to the sensors in s.yaml; then" in text


RUN: dict[str, object] = {
    "id": "r1ng32vh7ygq5", "name": "crossing at noon", "state": "completed-with-failures",
    "variant_count": 28_800, "rejected_count": 0,
    "created_at": "2026-11-21T12:15:00+00:00",
}  # fmt: skip


@pytest.mark.parametrize("reason", [None, "storage: no space left for artifacts"])
def test_the_list_of_runs_is_whole_on_a_terminal_of_80_columns(
    reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "console", lambda: Console(width=80, color_system=None))
    monkeypatch.setattr("valerie.client.Client.runs", lambda *_: [Run.model_validate({**RUN, "reason": reason})])
    shown = CliRunner().invoke(app, ["status", "--url", "http://h:1"]).stdout
    assert "…" not in shown
    for part in ("r1ng32vh7ygq5", "completed-with-failures", "28,800", "2026-11-21 12:15", reason or "crossing"):
        assert part in shown


def test_the_command_to_follow_a_run_names_the_server_that_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("valerie.client.Client.submit", lambda *_, **__: Run.model_validate({**RUN, "reason": None}))
    result = CliRunner().invoke(app, ["submit", "-", "--url", "http://h:1", "--data-dir", "d d"], input=SPEC)
    assert result.exit_code == 0, result.output
    assert "status r1ng32vh7ygq5 --watch --url http://h:1 --data-dir 'd d'" in result.stderr
