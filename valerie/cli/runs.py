"""Commands that start, follow and control runs."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.cli.option_documents import takes_documents
from valerie.cli.registering import Remote, open_registry
from valerie.cli.shell import (
    AsJson,
    DataDir,
    EndWithParent,
    Exit,
    ReportOfRun,
    RunId,
    Stopped,
    Url,
    print_json,
    save,
    say,
)
from valerie.cli.specs import Functions, resolvable, spec_text
from valerie.errors import InvalidInput
from valerie.local.deployment import settings_of
from valerie.local.terminal import command_name, console
from valerie.runs.products.states import Priority

if TYPE_CHECKING:
    from valerie.answers import Run
    from valerie.cli.connecting import System

_UNITS: Final = {"min": timedelta(minutes=1), "h": timedelta(hours=1), "d": timedelta(days=1)}

SpecFile = Annotated[Path, typer.Argument(metavar="SPEC", help="YAML or JSON file; - reads standard input.")]


def run(
    spec: SpecFile,
    functions: Functions = None,
    report: ReportOfRun = None,
    claims: Annotated[
        Path | None,
        typer.Option("--claims", metavar="FILE", help="Also test these claims, and include them in the report."),
    ] = None,
    json_lines: AsJson = False,
    data_dir: DataDir = None,
    end_with_parent: EndWithParent = False,
) -> None:
    """Run a validation on this machine and show its result.

    Uses the server that runs on the data folder, or starts one (Redis, API and
    one worker per queue) that ends with this command. Finished products are
    reused when you run the same spec again, also after Ctrl-C.
    """
    from valerie.cli.claims import read_claims, show_ledger
    from valerie.cli.connecting import own_assets, system_of
    from valerie.cli.following import report_path
    from valerie.cli.reports import report_with_claims
    from valerie.local.display import print_event

    _bind_to_parent(end_with_parent)
    statements = None if claims is None else read_claims(claims)
    settings = settings_of(data_dir)
    text = spec_text(spec, functions, partial(open_registry, settings, create=True))
    resolvable(text, settings)
    with system_of(settings) as system:
        with own_assets(settings, system.client), _submitting(data_dir):
            run = system.client.submit(text)
        if json_lines:
            print_event("started", run=run.id, url=system.client.url, variants=run.variant_count)
        path = report or report_path(settings, run.name, run.id)
        again = _run_command(spec, functions, data_dir)
        code = _see_to_its_end(system, run, path, again, data_dir, json_lines=json_lines)
        if statements is not None and code in (Exit.OK, Exit.COMPLETED_WITH_FAILURES):
            # Its report is saved already, so that a claim which does not fit the run costs no result.
            answered = report_with_claims([run.id], statements, None, data_dir)
            show_ledger(statements, answered.source.ledger, as_json=json_lines)
            save(answered.html.encode(), path)
        if not json_lines and code in (Exit.OK, Exit.COMPLETED_WITH_FAILURES):
            show_next(system, spec, text, functions=functions, data_dir=data_dir)
    if code != Exit.OK:
        raise typer.Exit(code)


def up(data_dir: DataDir = None, end_with_parent: EndWithParent = False) -> None:
    """Start server, workers and dashboard on this machine, and keep them running until Ctrl-C.

    Unfinished runs continue. Other commands find this server by its data folder.
    """
    from valerie.cli.connecting import system_of

    _bind_to_parent(end_with_parent)
    with system_of(settings_of(data_dir)) as system:
        url = system.client.url
        submit_command = _command_line("submit", "SPEC", data_dir=data_dir)
        say(f"\nDashboard  {url}/dashboard/\nREST API   {url}/openapi.json\nSubmit     {submit_command}")
        if not system.owned:
            return
        say("\nPress Ctrl-C to stop; unfinished runs continue with the next start.")
        while True:
            system.check()
            time.sleep(0.5)


@dataclass(frozen=True)
class _Urgency:
    """A run's part of the work of its owner."""

    priority: Annotated[
        Priority,
        typer.Option(help="A high run gets four times the work of a normal one of its owner, a low one a quarter."),
    ] = Priority.NORMAL
    deadline: Annotated[
        str | None,
        typer.Option(
            "--deadline",
            metavar="MOMENT",
            help="When it should be done, such as 2026-12-01T06:00Z (UTC unless it names a time zone). Among the runs of its "
            "owner, it gets more of the work as the time gets short, at most eight times.",
        ),
    ] = None
    within: Annotated[
        str | None, typer.Option("--within", metavar="TIME", help="The same as a time from now: 90min, 4h or 2d.")
    ] = None

    def due(self) -> datetime | None:
        """Return the deadline, if any."""
        if self.within is not None:
            if self.deadline is not None:
                raise InvalidInput("excludes --deadline", field="--within", value=self.within, limit="one of both")
            found = re.fullmatch(r"(\d{1,6})(min|h|d)", self.within)
            if found is None:
                limit = "a number with min, h or d, such as 4h"
                raise InvalidInput("is no time", field="--within", value=self.within, limit=limit)
            return datetime.now(UTC) + int(found[1]) * _UNITS[found[2]]
        if self.deadline is None:
            return None
        try:
            from valerie.runs.moments import in_utc

            return in_utc(datetime.fromisoformat(self.deadline))
        except ValueError:
            limit = "ISO 8601, such as 2026-12-01T06:00Z"
            raise InvalidInput("is no moment", field="--deadline", value=self.deadline, limit=limit) from None


@takes_documents
def submit(
    spec: SpecFile,
    urgency: _Urgency,
    functions: Functions = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Follow the run to its end.")] = False,
    key: Annotated[
        str | None,
        typer.Option("--key", help="Idempotency key: submitting again with the same key starts no second run."),
    ] = None,
    json_lines: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Submit a spec to a running server, and print the run's id."""
    from valerie.cli.connecting import client_of, own_assets

    due = urgency.due()
    settings = settings_of(data_dir)
    with client_of(settings, url) as client:
        text = spec_text(spec, functions, lambda: nullcontext(Remote(client)))
        with own_assets(settings, client), _submitting(data_dir, url):
            run = client.submit(text, idempotency_key=key, priority=urgency.priority, deadline=due)
        if not watch:
            typer.echo(run.model_dump_json() if json_lines else run.id)
            say(f"follow it with: {_command_line('status', run.id, '--watch', data_dir=data_dir, url=url)}")
            return
    status(run.id, watch=True, json_lines=json_lines, url=url, data_dir=data_dir)


def status(
    run_id: Annotated[
        str | None, typer.Argument(metavar="RUN", help="Id of a run; without it, the latest runs.")
    ] = None,
    watch: Annotated[
        bool, typer.Option("--watch", "-w", help="Follow the run to its end, then show its result.")
    ] = False,
    tag: Annotated[str | None, typer.Option("--tag", help="Only runs with this tag.")] = None,
    json_lines: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Show the latest runs, or the progress of one.

    Needs no server, except to follow a run. With --watch, the exit code is that of
    the run, as with `valerie run`.
    """
    from valerie.cli.connecting import System, client_at, source_of
    from valerie.cli.following import exit_code, failure_lines, follow, show_result, show_verdicts
    from valerie.local.display import display_of, progress_table

    if watch and run_id is not None:
        with client_at(url, data_dir) as client:
            system = System(client, owned=False, check=lambda: None)
            run = client.run(run_id)
            progress = follow(system, run_id, display_of(f"{run.name} ({run_id})", run_id, json_lines=json_lines))
            show_result(client, run_id, progress, None, json_lines=json_lines)
            if not json_lines and exit_code(progress.state) is not Exit.NOT_COMPLETED:
                say(f"\nReport    {_command_line('report', run_id, data_dir=data_dir, url=url)}")
            raise typer.Exit(exit_code(progress.state))
    with source_of(data_dir, url) as source:
        if run_id is None:
            _list(list(source.runs(tag=tag)), as_json=json_lines)
            return
        run, progress = source.run(run_id), source.progress(run_id)
        if json_lines:
            print_json({"run": run.id, "name": run.name, **progress.model_dump(mode="json")})
            return
        out = console()
        show_verdicts(source, run_id, progress)
        out.print(progress_table(f"{run.name} ({run_id})", progress))
        if any(stage.failed for stage in progress.stages.values()):
            for line in failure_lines(source.failures(run_id)):
                out.print(line, style="red")


def cancel(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Stop a run. Finished products stay, and `resume` continues the run."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        _say_state(client.cancel(run_id))
    say(f"continue it with: {_command_line('resume', run_id, data_dir=data_dir, url=url)}")


def resume(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Continue a paused or cancelled run.

    If no server runs on the data folder, this command starts one, completes the
    run and shows its result. That also continues a run whose server ended.
    """
    from valerie.cli.connecting import source_of, system_of
    from valerie.cli.following import report_path
    from valerie.errors import Conflict
    from valerie.local.folder import Folder
    from valerie.runs.products.states import RunState

    with source_of(data_dir, url) as source:
        if not isinstance(source, Folder):
            _say_state(source.resume(run_id))
            return
        run = source.run(run_id)
    if RunState(run.state).is_final and run.state != RunState.CANCELLED:
        raise Conflict(f"run {run.id} is {run.state}; it has nothing left to do")
    settings = settings_of(data_dir)
    with system_of(settings) as system:
        if run.state in (RunState.CANCELLED, RunState.PAUSED):
            system.client.resume(run_id)
        again = _command_line("resume", run_id, data_dir=data_dir)
        code = _see_to_its_end(system, run, report_path(settings, run.name, run.id), again, data_dir)
    if code != Exit.OK:
        raise typer.Exit(code)


def retry(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Retry the products of a run that failed for good."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        _say_state(client.retry(run_id))


def delete(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Delete an ended run. `valerie gc` then removes products that no other run needs."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        client.delete(run_id)
    gc = _command_line("gc", data_dir=data_dir)
    say(f"run {run_id} is deleted; `{gc}` removes products that no other run needs")


def _say_state(run: Run) -> None:
    say(f"run {run.id} is {run.state}" + (f": {run.reason}" if run.reason else ""))


def _bind_to_parent(requested: bool) -> None:
    """End this command when its parent ends, e.g. ``make``, even if the parent is killed."""
    if requested:
        from valerie.parent import end_with_parent

        end_with_parent()


def _see_to_its_end(
    system: System, run: Run, report: Path, again: str, data_dir: Path | None, *, json_lines: bool = False
) -> Exit:
    """Show the progress of a run, then its result; return the exit code.

    If the user stops this command, ``again`` is the one that continues the run.
    """
    from valerie.cli.following import exit_code, follow, show_result
    from valerie.local.display import display_of

    try:
        progress = follow(system, run.id, display_of(f"{run.name} ({run.id})", run.id, json_lines=json_lines))
    except Stopped as stopped:
        _stop_following(system, run.id, stopped, again, data_dir)
        raise
    show_result(system.client, run.id, progress, report, json_lines=json_lines)
    return exit_code(progress.state)


@contextmanager
def _submitting(data_dir: Path | None, url: str | None = None) -> Iterator[None]:
    """Tell the user where to look for a run that the server may have taken, if a signal ends the command meanwhile."""
    try:
        yield
    except Stopped:
        listing = _command_line("status", data_dir=data_dir, url=url)
        say(f"\nstopped before the server answered; if it took the run, this lists it: {listing}")
        raise


def _stop_following(system: System, run_id: str, stopped: Stopped, command: str, data_dir: Path | None) -> None:
    """Cancel the run of an interrupted command if its system ends too, and tell the user how to continue."""
    import signal

    from valerie.errors import ValerieError

    if not system.owned:
        follow = _command_line("status", run_id, "--watch", data_dir=data_dir)
        cancel = _command_line("cancel", run_id, data_dir=data_dir)
        say(f"\nrun {run_id} continues in the server; follow it with: {follow}\nend it with: {cancel}")
        return
    if stopped.signum != signal.SIGINT:
        say(f"\nrun {run_id} is interrupted; continue it with: {_command_line('up', data_dir=data_dir)}")
        return
    try:  # so that an interrupted run does not compete with the next one
        system.client.cancel(run_id)
    except ValerieError as error:
        say(f"\nrun {run_id} could not be cancelled: {error}")
    else:
        say(f"\nrun {run_id} is cancelled; continue where it stopped with: {command}")


def show_next(system: System, spec: Path, text: bytes, *, functions: str | None, data_dir: Path | None) -> None:
    """Print the address of the dashboard, or the command that serves it, and a suggestion for the next run."""
    from rich.table import Table
    from rich.text import Text

    # The server of this command ends with it, and the next one may listen at another port.
    up = f"{_command_line('up', data_dir=data_dir)}  prints its address"
    table = Table.grid(padding=(0, 1))
    table.add_row("Dashboard", Text(up if system.owned else f"{system.client.url}/dashboard/"))
    if str(spec) != "-":
        table.add_row("Try next", Text(next_step(spec, text, functions=functions, data_dir=data_dir)))
    console().print(table)


def next_step(spec: Path, text: bytes, *, functions: str | None, data_dir: Path | None) -> str:
    """Return a suggestion for the user: a cheap change to the spec file, and the command that runs it."""
    from valerie.runs.resolving.spec import parse

    document = parse(text)
    # A named setting has a fixed exposure, which is black by night, where the run's camera meters.
    metering = "auto_exposure: true, " if document.sensors[0].auto_exposure else ""
    dark = f"{{name: dark, {metering}exposure_ev: -2}}"
    if "sensors" in document.model_fields_set:
        change = f"add  {dark}  to the sensors in {spec}"
    else:
        change = f"add the line  sensors: [{{name: metered, auto_exposure: true}}, {dark}]  to {spec}"
    return (
        f"{change}; then {_run_command(spec, functions, data_dir)}\n"
        "renders nothing new: the functions only evaluate darker pictures"
    )


def _run_command(spec: Path, functions: str | None, data_dir: Path | None) -> str:
    """Return the command line that runs a spec."""
    return _command_line(
        "run", str(spec), *([] if functions is None else ["--functions", functions]), data_dir=data_dir
    )


def _command_line(*command: str, data_dir: Path | None, url: str | None = None) -> str:
    """Return a command line for the same data folder or server, for the user to copy."""
    import shlex

    options = [*([] if url is None else ["--url", url]), *([] if data_dir is None else ["--data-dir", str(data_dir)])]
    return f"{command_name()} " + shlex.join([*command, *options])


def _list(runs: list[Run], *, as_json: bool) -> None:
    if as_json:
        for run in runs:
            typer.echo(run.model_dump_json())
        return
    if not runs:
        say(f"no runs yet; start one with: {command_name()} run SPEC")
        return
    from rich.table import Table

    from valerie.runs.moments import moment_text

    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("run", no_wrap=True)
    table.add_column("name", overflow="fold")
    table.add_column("state", no_wrap=True)
    table.add_column("variants", justify="right", no_wrap=True)
    table.add_column("created", no_wrap=True)
    dated = any(run.deadline for run in runs)
    if dated:
        table.add_column("deadline", no_wrap=True)
    tagged = any(run.tags for run in runs)
    if tagged:
        table.add_column("tags", overflow="fold")
    for run in runs:
        created = moment_text(run.created_at)
        due = [moment_text(run.deadline) if run.deadline else ""] if dated else []
        tags = [", ".join(run.tags)] if tagged else []
        state = f"{run.state}, archived" if run.archived else run.state
        table.add_row(run.id, run.name, state, f"{run.variant_count:,}", created, *due, *tags)
    out = console()
    out.print(table)
    for run in runs:
        if run.reason:
            out.print(f"{run.id}: {run.reason}", style="yellow")
