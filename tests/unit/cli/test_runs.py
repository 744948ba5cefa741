"""The last lines of `valerie run`."""

from __future__ import annotations

import json
import signal
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml
from rich.console import Console
from typer.testing import CliRunner

from tests.world.blank import Pipeline, street_pipeline
from tests.world.boxes import write_box_street
from valerie.answers import Progress, Run, RunSummary, VariantProgress
from valerie.cli import runs
from valerie.cli.connecting import System
from valerie.cli.main import app
from valerie.cli.runs import next_step
from valerie.cli.shell import Exit, Stopped
from valerie.client import Client, ServerProblemError
from valerie.errors import InvalidInput, NotFound

SPEC = "name: s\nasset: urban-street\nfunctions: [my-net]\n"


def test_the_next_step_repeats_the_command_with_the_functions_and_the_folder_it_was_given() -> None:
    text = next_step(Path("my spec.yaml"), SPEC.encode(), functions="my-net,other", data_dir=Path("/data here"))
    assert "run 'my spec.yaml' --functions my-net,other --data-dir '/data here'\n" in text
    plain = next_step(Path("s.yaml"), SPEC.encode(), functions=None, data_dir=None)
    assert "add the line  sensors: [" in plain
    assert "  to s.yaml; then" in plain
    assert "run s.yaml\n" in plain


def test_a_spec_with_sensors_gets_one_more_and_not_a_second_list() -> None:
    text = next_step(Path("s.yaml"), f"{SPEC}sensors: [{{name: day}}]\n".encode(), functions=None, data_dir=None)
    assert "add  {name: dark, exposure_ev: -2}  to the sensors in s.yaml; then" in text


@pytest.mark.parametrize("sensors", ["", "sensors: [{name: day, auto_exposure: true}]\n"])
def test_the_suggested_sensors_meter_where_those_of_the_run_do(sensors: str) -> None:
    text = next_step(Path("s.yaml"), f"{SPEC}{sensors}".encode(), functions=None, data_dir=None)
    suggested = yaml.safe_load(text.split("  ")[1].removeprefix("sensors: "))
    assert all(sensor["auto_exposure"] for sensor in (suggested if isinstance(suggested, list) else [suggested]))


def test_no_address_is_named_of_a_server_that_ends_with_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with Client("http://127.0.0.1:8700") as client:
        for owned in (True, False):
            system = System(client, owned=owned, check=lambda: None)
            runs.show_next(system, Path("s.yaml"), SPEC.encode(), functions=None, data_dir=Path("/data"))
    ended, stays = (text for text in capsys.readouterr().out.split("Dashboard") if text)
    assert "8700" not in ended
    assert "up --data-dir /data  prints its address" in ended
    assert "http://127.0.0.1:8700/dashboard/" in stays


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
    monkeypatch.setattr("valerie.client.Client.runs", lambda *_, **__: [Run.model_validate({**RUN, "reason": reason})])
    shown = CliRunner().invoke(app, ["status", "--url", "http://h:1"]).stdout
    assert "…" not in shown
    for part in ("r1ng32vh7ygq5", "completed-with-failures", "28,800", "2026-11-21 12:15", reason or "crossing"):
        assert part in shown


def test_the_command_to_follow_a_run_names_the_server_that_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("valerie.client.Client.submit", lambda *_, **__: Run.model_validate({**RUN, "reason": None}))
    result = CliRunner().invoke(app, ["submit", "-", "--url", "http://h:1", "--data-dir", "d d"], input=SPEC)
    assert result.exit_code == 0, result.output
    assert "status r1ng32vh7ygq5 --watch --url http://h:1 --data-dir 'd d'" in result.stderr


@pytest.mark.parametrize(
    ("last", "code"),
    [
        ("completed", Exit.OK), ("completed-with-failures", Exit.COMPLETED_WITH_FAILURES),
        ("failed", Exit.NOT_COMPLETED), ("cancelled", Exit.NOT_COMPLETED),
    ],
)  # fmt: skip
def test_a_watched_submission_follows_its_run_to_the_end_and_exits_as_the_run_does(
    last: str, code: Exit, monkeypatch: pytest.MonkeyPatch
) -> None:
    states = ["submitted", "running", last]
    left = iter(states)

    def progress(*_: object) -> Progress:
        variants = VariantProgress(total=1, fed=1, rejected=0)
        return Progress(state=next(left), reason=None, variants=variants, stages={})

    run = Run.model_validate({**RUN, "reason": None})
    summary = RunSummary.model_validate({"summary": {"rows": []}, "findings": {}, "verdicts": []})
    answers = {
        "submit": lambda *_, **__: run,
        "run": lambda *_: run,
        "progress": progress,
        "summary": lambda *_: summary,
    }
    for name, answer in answers.items():
        monkeypatch.setattr(f"valerie.client.Client.{name}", answer)
    result = CliRunner().invoke(app, ["submit", "-", "--watch", "--json", "--url", "http://h:1"], input=SPEC)
    events = [json.loads(line) for line in result.stdout.splitlines()]
    assert [event["state"] for event in events] == [*states, last]
    assert (events[-1]["event"], events[-1]["run"], events[-1]["exit_code"]) == ("finished", run.id, int(code))
    assert result.exit_code == code


def test_a_submission_that_a_signal_stops_says_where_its_run_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> Run:
        raise Stopped(signal.SIGINT)

    monkeypatch.setattr("valerie.client.Client.submit", stop)
    result = CliRunner().invoke(app, ["submit", "-", "--url", "http://h:1"], input=SPEC)
    assert result.exit_code == 130
    assert "if it took the run, this lists it: " in result.stderr
    assert "status --url http://h:1" in result.stderr


def test_status_and_report_read_the_data_folder_when_no_server_runs(
    invoke: CliRunner, deployed: tuple[Path, str], tmp_path: Path
) -> None:
    folder, run_id = deployed
    data = ["--data-dir", str(folder / "data")]
    assert run_id in invoke.invoke(app, ["status", *data], catch_exceptions=False).stdout
    shown = invoke.invoke(app, ["status", run_id, *data], catch_exceptions=False).stdout
    assert "completed" in shown
    assert "24 / 24 frames" in shown
    report = tmp_path / "report.html"
    invoke.invoke(app, ["report", run_id, "--output", str(report), *data], catch_exceptions=False)
    assert report.read_text().startswith("<!DOCTYPE html>")
    with pytest.raises(NotFound):
        invoke.invoke(app, ["status", "r0000000000", *data], catch_exceptions=False)


def test_a_run_that_waits_for_a_server_says_how_to_continue_it(tmp_path: Path, invoke: CliRunner) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    run_id = Pipeline(tmp_path / "d d", tmp_path / "assets").submit()
    shown = invoke.invoke(app, ["status", run_id, "--data-dir", str(tmp_path / "d d")], catch_exceptions=False).stdout
    assert "no server runs; `" in shown
    assert f"up --data-dir '{tmp_path / 'd d'}'` continues the run" in shown


def test_cancelling_prints_the_command_that_continues_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("valerie.client.Client.cancel", lambda *_: Run.model_validate({**RUN, "state": "cancelled"}))
    message = CliRunner().invoke(app, ["cancel", "r1ng32vh7ygq5", "--url", "http://h:1", "--data-dir", "d d"]).stderr
    assert "run r1ng32vh7ygq5 is cancelled\n" in message
    assert "resume r1ng32vh7ygq5 --url http://h:1 --data-dir 'd d'" in message


@pytest.mark.parametrize("command", [["submit", "-"], ["plan", "-"]])
def test_an_asset_of_the_callers_own_folder_that_the_server_does_not_know_is_explained(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> Run:
        raise ServerProblemError(422, "Unknown name", "asset: unknown asset 'box-street'; known: urban-street")

    monkeypatch.setattr("valerie.client.Client.submit", refuse)
    monkeypatch.setattr("valerie.client.Client.plan", refuse)
    arguments = [*command, "--url", "http://h:1"]
    text = SPEC.replace("urban-street", "box-street")
    refused = CliRunner().invoke(app, arguments, input=text)
    assert isinstance(refused.exception, ServerProblemError)  # nor does the caller have it
    write_box_street(tmp_path / "box-street")
    monkeypatch.setenv("VALERIE_ASSET_DIR", str(tmp_path))
    explained = CliRunner().invoke(app, arguments, input=text)
    assert isinstance(explained.exception, InvalidInput)
    assert f"the asset is in {tmp_path}" in str(explained.exception)


def test_a_deadline_is_a_moment_or_a_time_from_now(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[datetime] = []

    def submit(*_: object, deadline: datetime, **__: object) -> Run:
        sent.append(deadline)
        return Run.model_validate(RUN)

    monkeypatch.setattr("valerie.client.Client.submit", submit)
    before = datetime.now(UTC)
    for options in (["--deadline", "2026-12-01T06:00Z"], ["--deadline", "2026-12-01T06:00"], ["--within", "4h"]):
        result = CliRunner().invoke(app, ["submit", "-", "--url", "http://h:1", *options], input=SPEC)
        assert result.exit_code == 0, result.output
    assert sent[0] == sent[1] == datetime(2026, 12, 1, 6, tzinfo=UTC)
    assert timedelta(hours=4) <= sent[2] - before <= timedelta(hours=4, minutes=1)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--deadline", "noon"], r"--deadline: is no moment; got noon; limit: ISO 8601"),
        (["--within", "4 hours"], r"--within: is no time; got 4 hours; limit: a number with min, h or d"),
        (["--within", "4h", "--deadline", "2026-12-01"], r"--within: excludes --deadline"),
    ],
)
def test_a_deadline_that_is_none_is_refused(options: list[str], said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        CliRunner().invoke(app, ["submit", "-", "--url", "http://h:1", *options], input=SPEC, catch_exceptions=False)


def test_status_says_whether_a_deadline_will_be_met(tmp_path: Path, invoke: CliRunner) -> None:
    pipeline = street_pipeline(tmp_path)
    pipeline.submit()
    run_id = pipeline.submit(deadline=datetime.now(UTC) + timedelta(hours=2, seconds=90))
    data = ["--data-dir", str(tmp_path / "data")]
    assert "deadline in 2 h " in invoke.invoke(app, ["status", run_id, *data], catch_exceptions=False).stdout
    assert "deadline" in invoke.invoke(app, ["status", *data], catch_exceptions=False).stdout
