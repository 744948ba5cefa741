"""Watching a run to its end."""

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import httpx
import pytest

from valerie.answers import Failure, Progress, Study, StudyBatch, VariantProgress
from valerie.cli.connecting import System
from valerie.cli.following import Patience, exit_code, failure_lines, follow, report_path, show_result
from valerie.cli.studies import follow_study
from valerie.client import Client, ServerUnavailableError
from valerie.errors import ValerieError
from valerie.local.display import JsonDisplay
from valerie.runs.products.states import RunState
from valerie.settings import load_settings


def _progress(state: str, reason: str | None = None) -> Progress:
    return Progress(state=state, reason=reason, variants=VariantProgress(total=1, fed=1, rejected=0), stages={})


def _system(answer: Callable[[httpx.Request], httpx.Response], check: Callable[[], None] = lambda: None) -> System:
    client = Client("http://127.0.0.1:1", transport=httpx.MockTransport(answer))
    return System(client, owned=False, check=check)


AT_ONCE = Patience(poll=0.0)


def test_a_run_is_followed_to_its_end() -> None:
    states = iter(["submitted", "running", "running", "finishing", "completed"])
    system = _system(lambda _: httpx.Response(200, json=_progress(next(states)).model_dump()))
    assert follow(system, "r1", JsonDisplay("r1"), AT_ONCE).state == "completed"
    assert next(states, None) is None


@pytest.mark.parametrize(
    ("patience", "reason"), [(60.0, "the workers are starting"), (0.0, "waiting for a render worker")]
)
def test_workers_of_an_own_system_may_take_a_while_to_start(
    capsys: pytest.CaptureFixture[str], patience: float, reason: str
) -> None:
    states = iter(["submitted", "completed"])
    output = _system(
        lambda _: httpx.Response(200, json=_progress(next(states), "waiting for a render worker").model_dump())
    )
    follow(replace(output, owned=True), "r1", JsonDisplay("r1"), Patience(poll=0.0, start=patience))
    assert json.loads(capsys.readouterr().out.splitlines()[0])["reason"] == reason


def test_a_server_that_is_started_again_is_waited_for() -> None:
    calls = iter([None, None, "completed"])

    def answer(request: httpx.Request) -> httpx.Response:
        state = next(calls)
        if state is None:
            raise httpx.ConnectError("refused", request=request)
        return httpx.Response(200, json=_progress(state).model_dump())

    assert follow(_system(answer), "r1", JsonDisplay("r1"), AT_ONCE).state == "completed"


def test_a_server_that_stays_away_is_an_error() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused", request=request)

    with pytest.raises(ServerUnavailableError):
        follow(_system(answer), "r1", JsonDisplay("r1"), Patience(poll=0.0, restart=0.0))


def test_a_process_that_was_given_up_ends_the_wait() -> None:
    def check() -> None:
        raise ValerieError("the infer process ended 5 times")

    with pytest.raises(ValerieError, match="infer"):
        follow(_system(lambda _: httpx.Response(500), check), "r1", JsonDisplay("r1"), AT_ONCE)


@pytest.mark.parametrize(
    ("state", "code"),
    [("completed", 0), ("completed-with-failures", 3), ("cancelled", 4), ("failed", 4)],
)
def test_the_exit_code_tells_how_a_run_ended(state: str, code: int) -> None:
    assert exit_code(state) == code


def test_every_final_state_has_an_exit_code() -> None:
    for state in RunState:
        if state.is_final:
            exit_code(state)


def test_alike_failures_stand_together_and_consequences_are_left_out() -> None:
    failures = [
        {"kind": "layer", "error": {"message": "black image", "attempts": 4}},
        {"kind": "layer", "error": {"message": "black image", "attempts": 3}},
        {"kind": "truth", "error": {"message": "no context", "attempts": 4}},
        {"kind": "prediction", "error": {"message": "input failed", "cause": "abc", "attempts": 0}},
        {"kind": "prediction", "error": None},
    ]
    assert failure_lines([Failure.model_validate(failure) for failure in failures]) == [
        "  2 × layer: black image (after 4 attempts)",
        "  1 × truth: no context (after 4 attempts)",
        "  1 × prediction: unknown error (after 0 attempts)",
    ]


def test_many_kinds_of_failure_are_cut_with_a_count() -> None:
    failures = [{"kind": "layer", "error": {"message": f"error {n}", "attempts": 1}} for n in range(9)]
    assert (
        failure_lines([Failure.model_validate(failure) for failure in failures])[-1]
        == "  … and 4 other errors; the report lists all"
    )


def test_a_report_gets_a_plain_name_beside_the_data_folder(tmp_path: Path) -> None:
    settings = load_settings(data_dir=tmp_path / "var" / "valerie")
    path = report_path(settings, "First run: 2/3 ../ Straße", "r1")
    assert path == tmp_path / "var" / "reports" / "first-run-2-3-strasse-r1.html"
    assert report_path(settings, "…", "r1").name == "run-r1.html"


def test_the_last_json_line_holds_state_exit_code_summary_and_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/summary"):
            return httpx.Response(200, json={"summary": {"rows": []}, "findings": {}, "verdicts": []})
        return httpx.Response(200, content=b"<html>")

    progress = _progress("completed-with-failures", "1 product failed for good")
    show_result(_system(answer).client, "r1", progress, tmp_path / "report.html", json_lines=True)
    event = json.loads(capsys.readouterr().out)
    assert event["event"] == "finished"
    assert event["exit_code"] == 3
    assert event["summary"] == {"summary": {"rows": []}, "findings": {}, "verdicts": []}
    assert Path(event["report"]).name == "report.html"


def test_a_cancelled_run_shows_why_and_asks_for_no_results(capsys: pytest.CaptureFixture[str]) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        assert request.url.path.endswith("/failures")
        return httpx.Response(200, json=[])

    show_result(_system(answer).client, "r1", _progress("cancelled", "on request"), None, json_lines=False)
    assert "The run is cancelled: on request" in capsys.readouterr().err


def test_warnings_come_before_the_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    searched = {"comparisons": 0, "level": 0.95, "places_searched": 0, "places_confirming": 0}
    findings = {"items": [], "candidates": [], **searched}
    numbers = {"threshold": 0.5, "frames": 0, "rows": [], "occlusion": [], "empty": [], "warnings": ["net is silent."]}

    def answer(_: httpx.Request) -> httpx.Response:
        return httpx.Response(200, json={"summary": numbers, "findings": findings, "verdicts": []})

    show_result(_system(answer).client, "r1", _progress("completed"), None, json_lines=False)
    output = capsys.readouterr().out
    assert output.index("Warning: net is silent.") < output.index("No person was evaluated.")


@pytest.mark.parametrize("accepted", [False, True])
def test_only_a_batch_that_waits_for_a_person_is_to_be_accepted(
    capsys: pytest.CaptureFixture[str], accepted: bool
) -> None:
    now = datetime(2026, 1, 1, tzinfo=UTC)
    batch = StudyBatch(
        number=0,
        reason="even",
        legal=4,
        accepted_at=now if accepted else None,
        run_id=None,
        outcomes=None,
        cpu_seconds=None,
    )
    waiting = Study(
        id="s1",
        name="night",
        state="running",
        reason="it waits",
        by_hand=True,
        goal="rate",
        created_at=now,
        batches=(batch,),
    )
    answers = iter([waiting, waiting.model_copy(update={"state": "stopped"})])
    system = _system(lambda _: httpx.Response(200, json=next(answers).model_dump(mode="json")))
    follow_study(system, "s1", quiet=False)
    output = capsys.readouterr()
    assert "it waits" in output.out + output.err
    assert ("study accept s1" in output.out + output.err) is not accepted


def test_a_study_shows_the_progress_of_its_oldest_open_batch_and_what_it_waits_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = datetime(2026, 1, 1, tzinfo=UTC)
    common = {"reason": "even", "legal": 4, "accepted_at": now, "outcomes": None, "cpu_seconds": None}
    batches = tuple(StudyBatch(number=number, run_id=f"r{number}", **common) for number in range(2))
    study = Study(id="s1", name="night", state="running", by_hand=False, goal="rate", created_at=now, batches=batches)
    states = iter(["running", "stopped"])

    def answer(request: httpx.Request) -> httpx.Response:
        if "/studies/" in request.url.path:
            told = study.model_copy(update={"state": next(states)})
        else:
            assert "/r0/" in request.url.path
            told = _progress("running", "waiting for a render worker")
        return httpx.Response(200, json=told.model_dump(mode="json"))

    follow_study(_system(answer), "s1", quiet=False)
    assert "batch 1: running, waiting for a render worker" in capsys.readouterr().err
