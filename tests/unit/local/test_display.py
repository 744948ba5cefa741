"""The display of progress."""

import json

import pytest
from rich.console import Console

from valerie.answers import Progress, StageProgress, VariantProgress
from valerie.local.display import STAGES, JsonDisplay, LineDisplay, progress_line, progress_table
from valerie.runs.moments import duration


def _progress(done: int = 30, *, state: str = "running", failed: int = 0, reason: str | None = None) -> Progress:
    return Progress(
        state=state,
        reason=reason,
        variants=VariantProgress(total=48, fed=48, rejected=2),
        stages={
            "render": StageProgress(done=done, total=138, failed=failed, running=4, rate_per_s=6.1, eta_s=17.7),
            "infer": StageProgress(done=0, total=276, failed=0, running=0, rate_per_s=0.0, eta_s=None),
        },
    )


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.2, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (200, "3 min 20 s"),
        (3600, "1 h 0 min"),
        (90_000, "1 d 1 h"),
    ],
)
def test_durations_are_written_for_people(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_table_shows_done_total_rate_remaining_time_and_failures_of_each_stage() -> None:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(progress_table("first (r1)", _progress(failed=3)))
    head, render, infer = capture.get().splitlines()[:3]
    assert "first (r1)  running  48 variants, 2 rejected" in head
    for part in ("render", "30 / 138 frames", "6.1/s", "18 s left", "3 failed"):
        assert part in render
    assert "0 / 276 predictions" in infer
    assert "failed" not in infer


def test_a_complete_stage_has_no_rate() -> None:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(progress_table("first (r1)", _progress(done=138)))
    assert "done" in capture.get()
    assert "6.1/s" not in capture.get() + progress_line("first", _progress(done=138))
    assert "6.1/s" in progress_line("first", _progress())


def test_nothing_is_cut_on_a_terminal_of_80_columns() -> None:
    console = Console(width=80, color_system=None)
    stage = StageProgress(done=1_234, total=28_800, failed=1_234, running=4, rate_per_s=16.1, eta_s=2000.7)
    progress = _progress().model_copy(update={"stages": dict.fromkeys(("render", "infer", "eval"), stage)})
    with console.capture() as captured:
        console.print(progress_table("first-run (r1)", progress))
    lines = captured.get().splitlines()
    assert "…" not in captured.get()
    for line, name, unit in zip(lines[1:], ("render", "infer", "eval"), STAGES.values(), strict=True):
        assert line.strip().startswith(name)
        assert line.endswith(f"1,234 / 28,800 {unit} 16.1/s 33 min 21 s left 1,234 failed")


def test_the_table_shows_why_a_run_waits() -> None:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(progress_table("first", _progress(reason="no living worker serves [infer]")))
    assert "no living worker serves [infer]" in capture.get()


def test_a_line_says_the_same() -> None:
    assert progress_line("first", _progress(failed=3, reason="waits")) == (
        "first: running, render 30/138 (3 failed) 6.1/s, infer 0/276, waits"
    )


def test_a_line_has_the_remaining_time_of_the_last_stage_once_every_stage_has_one() -> None:
    progress = _progress()
    assert " left" not in progress_line("first", progress)
    stages = {**progress.stages, "infer": progress.stages["infer"].model_copy(update={"eta_s": 95.0})}
    assert "about 1 min 35 s left" in progress_line("first", progress.model_copy(update={"stages": stages}))


def test_a_run_that_ended_has_no_remaining_time() -> None:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(progress_table("first", _progress(state="cancelled")))
    assert "left" not in capture.get() + progress_line("first", _progress(state="cancelled"))


def test_lines_come_with_a_change_of_state_not_with_every_frame(capsys: pytest.CaptureFixture[str]) -> None:
    display = LineDisplay("first")
    for done in (1, 2, 3):
        display.update(_progress(done))
    display.update(_progress(138, state="completed"))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["first: running", "first: completed"]


def test_json_lines_come_with_every_change_and_only_then(capsys: pytest.CaptureFixture[str]) -> None:
    display = JsonDisplay("r1")
    for done in (1, 1, 2):
        display.update(_progress(done))
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [event["stages"]["render"]["done"] for event in events] == [1, 2]
    assert {(event["event"], event["run"], event["state"]) for event in events} == {("progress", "r1", "running")}


def test_the_display_follows_where_the_output_goes() -> None:
    from valerie.local.display import display_of

    assert isinstance(display_of("first", "r1", json_lines=False), LineDisplay)  # captured: no terminal
    assert isinstance(display_of("first", "r1", json_lines=True), JsonDisplay)
