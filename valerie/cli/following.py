"""Follow a run to its end, and show its result."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from valerie.answers import Failure, Progress, RunSummary
from valerie.cli.connecting import System
from valerie.cli.shell import Exit, save
from valerie.client import Client, ServerUnavailableError
from valerie.local.display import Display, print_event
from valerie.local.folder import Folder
from valerie.local.terminal import console
from valerie.plain import typed
from valerie.runs.products.states import RunState
from valerie.settings import Settings
from valerie.spelling import plain_name

_EXIT: Final = {
    RunState.COMPLETED: Exit.OK,
    RunState.COMPLETED_WITH_FAILURES: Exit.COMPLETED_WITH_FAILURES,
    RunState.CANCELLED: Exit.NOT_COMPLETED,
    RunState.FAILED: Exit.NOT_COMPLETED,
}


#: Most kinds of errors that are listed.
_SHOWN: Final = 5


@dataclass(frozen=True, slots=True)
class Patience:
    """Waiting times, seconds.

    Attributes:
        poll: time between two requests for the progress.
        restart: longest restart of a server after a crash.
        start: longest start of the workers of a system that this command started.
    """

    poll: float = 0.5
    restart: float = 60.0
    start: float = 60.0


def follow(system: System, run_id: str, display: Display, patience: Patience = Patience()) -> Progress:
    """Show a run's progress until it ends, and return the final progress.

    Raises:
        ServerUnavailableError: the server has been unreachable for longer than a restart takes.
        ValerieError: a process of a system that this command started keeps ending.
    """
    lost_at: float | None = None
    started_at = time.monotonic()
    with display:
        while True:
            system.check()
            try:
                progress = system.client.progress(run_id)
            except ServerUnavailableError:
                lost_at = lost_at or time.monotonic()
                if time.monotonic() - lost_at > patience.restart:
                    raise
            else:
                lost_at = None
                starting = system.owned and progress.state == RunState.SUBMITTED
                if starting and time.monotonic() - started_at < patience.start:
                    progress = progress.model_copy(update={"reason": "the workers are starting"})
                display.update(progress)
                if RunState(progress.state).is_final:
                    return progress
            time.sleep(patience.poll)


def exit_code(state: str) -> Exit:
    """Return the exit code for the final state of a run."""
    return _EXIT[RunState(state)]


def show_result(client: Client, run_id: str, progress: Progress, report: Path | None, *, json_lines: bool) -> None:
    """Show the result of an ended run: verdicts, the table of the paper's section 6.2, failures, the path of the report.

    Args:
        client: client of the server.
        run_id: id of the run.
        progress: final progress of the run.
        report: file for the report; None writes none.
        json_lines: True prints one JSON line instead.
    """
    summary = _summary(client, run_id, progress)
    path = save(client.report(run_id), report) if summary is not None and report is not None else None
    if json_lines:
        print_event(
            "finished",
            run=run_id,
            state=progress.state,
            reason=progress.reason,
            exit_code=int(exit_code(progress.state)),
            report=str(path) if path else None,
            summary=summary and summary.model_dump(),
        )
        return
    out = console()
    if summary is not None:
        from valerie.analysis.findings.findings import Findings
        from valerie.analysis.summary.summary import Summary
        from valerie.analysis.summary.text import summary_renderable

        out.print()
        show_first(summary)
        numbers, findings = typed(Summary, summary.summary), typed(Findings, summary.findings)
        out.print(summary_renderable(numbers, findings))
    if progress.state != RunState.COMPLETED:
        _show_failures(client, run_id, progress)
    if path is not None:
        out.print(f"\nReport    {path}")


def show_verdicts(source: Client | Folder, run_id: str, progress: Progress) -> None:
    """Show the warnings and the verdicts of an ended run; nothing for one without results."""
    summary = _summary(source, run_id, progress)
    if summary is not None:
        show_first(summary)


def _summary(source: Client | Folder, run_id: str, progress: Progress) -> RunSummary | None:
    has_results = progress.state in (RunState.COMPLETED, RunState.COMPLETED_WITH_FAILURES)
    return source.summary(run_id) if has_results else None


def show_first(summary: RunSummary) -> None:
    """Show the first part of the results: warnings, then verdicts."""
    from valerie.analysis.summary.summary import Summary
    from valerie.analysis.summary.text import warnings_renderable
    from valerie.analysis.verdicts.text import verdicts_renderable
    from valerie.analysis.verdicts.verdicts import RequirementVerdict

    out = console()
    out.print(warnings_renderable(typed(Summary, summary.summary)), end="")
    if summary.verdicts:
        out.print(verdicts_renderable(typed(tuple[RequirementVerdict, ...], summary.verdicts)))
        out.print()


def report_path(settings: Settings, name: str, run_id: str) -> Path:
    """Return the default path of a run's report: ``reports/<name>-<run>.html`` next to the data folder."""
    plain = plain_name(name, longest=60).lower() or "run"
    return settings.data_dir.parent / "reports" / f"{plain}-{run_id}.html"


def _show_failures(client: Client, run_id: str, progress: Progress) -> None:
    out = console(stderr=True)
    out.print(f"\nThe run is {progress.state}" + (f": {progress.reason}" if progress.reason else "."), style="red")
    for line in failure_lines(client.failures(run_id)):
        out.print(line)


def failure_lines(failures: list[Failure]) -> list[str]:
    """Return one line for each kind of product and error, the most frequent first.

    Products that failed because an input failed are left out; the input has its own line.
    """
    attempts: dict[tuple[str, str], list[int]] = {}
    for failure in failures:
        error = failure.error
        if error is None:
            attempts.setdefault((failure.kind, "unknown error"), []).append(0)
        elif error.cause is None:
            attempts.setdefault((failure.kind, str(error.message)), []).append(error.attempts or 0)
    ranked = sorted(attempts.items(), key=lambda item: -len(item[1]))
    lines = [
        f"  {len(counts):,} × {kind}: {message} (after {max(counts)} attempts)"
        for (kind, message), counts in ranked[:_SHOWN]
    ]
    if len(ranked) > _SHOWN:
        lines.append(f"  … and {len(ranked) - _SHOWN} other errors; the report lists all")
    return lines
