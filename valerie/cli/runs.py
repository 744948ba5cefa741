"""Commands that start, follow and steer runs."""

from __future__ import annotations

import json
import time
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.registry import Remote, open_registry
from valerie.cli.shell import (
    DataDir,
    EndWithParent,
    Exit,
    Json,
    Stopped,
    Url,
    command_name,
    console,
    say,
    settings_of,
)
from valerie.cli.specs import Functions, require_resolvable, spec_text

if TYPE_CHECKING:
    from valerie.cli.connecting import System
    from valerie.client import Run

SpecFile = Annotated[Path, typer.Argument(metavar="SPEC", help="YAML or JSON file; - reads standard input.")]
RunId = Annotated[str, typer.Argument(metavar="RUN", help="Id of a run, as `valerie status` lists it.")]


def run(
    spec: SpecFile,
    functions: Functions = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", help="Where the report goes.", show_default="reports/ beside the data folder"),
    ] = None,
    json_lines: Json = False,
    data_dir: DataDir = None,
    end_with_parent: EndWithParent = False,
) -> None:
    """Run a validation on this machine and show its result.

    Uses the server that runs on the data folder, or starts one (Redis, API and
    one worker per queue) that ends with this command. Running the same spec
    again makes nothing twice, also after Ctrl-C.
    """
    from valerie.cli.connecting import system_of
    from valerie.cli.display import display_of, print_event
    from valerie.cli.following import exit_code, follow, report_path, show_result

    _bind_to_parent(end_with_parent)
    settings = settings_of(data_dir)
    text = spec_text(spec, functions, partial(open_registry, settings, create=True))
    require_resolvable(text, settings)
    with system_of(settings) as system:
        run = system.client.submit(text)
        if json_lines:
            print_event("started", run=run.id, url=system.client.url, variants=run.variant_count)
        try:
            progress = follow(system, run.id, display_of(f"{run.name} ({run.id})", run.id, json_lines=json_lines))
        except Stopped as stopped:
            _leave(system, run.id, stopped, data_dir)
            raise
        path = report or report_path(settings, run.name, run.id)
        show_result(system.client, run.id, progress, path, json_lines=json_lines)
        code = exit_code(progress.state)
        if not json_lines and code in (Exit.OK, Exit.COMPLETED_WITH_FAILURES):
            _show_next(system, spec, text, functions=functions, data_dir=data_dir)
    if code != Exit.OK:
        raise typer.Exit(code)


def up(data_dir: DataDir = None, end_with_parent: EndWithParent = False) -> None:
    """Start server, workers and dashboard on this machine, and stay until Ctrl-C.

    Unfinished runs go on. Other commands find this server by its data folder.
    """
    from valerie.cli.connecting import system_of

    _bind_to_parent(end_with_parent)
    with system_of(settings_of(data_dir)) as system:
        url = system.client.url
        submitting = _again("submit", "SPEC", data_dir=data_dir)
        say(f"\nDashboard  {url}/dashboard/\nREST API   {url}/openapi.json\nSubmit     {submitting}")
        if not system.owned:
            return
        say("\nCtrl-C ends it; unfinished runs go on with the next start.")
        while True:
            system.check()
            time.sleep(0.5)


def submit(
    spec: SpecFile,
    functions: Functions = None,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Follow the run to its end.")] = False,
    key: Annotated[
        str | None, typer.Option("--key", help="Idempotency key: submitting again with it makes no second run.")
    ] = None,
    json_lines: Json = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Give a spec to a running server; prints the run's id."""
    from valerie.cli.connecting import client_of

    settings = settings_of(data_dir)
    with client_of(settings, url) as client:
        text = spec_text(spec, functions, lambda: nullcontext(Remote(client)))
        run = client.submit(text, idempotency_key=key)
        if not watch:
            _print(run.model_dump(mode="json"), run.id, as_json=json_lines)
            say(f"follow it with: {_again('status', run.id, '--watch', data_dir=data_dir, url=url)}")
            return
    status(run.id, watch=True, json_lines=json_lines, url=url, data_dir=data_dir)


def status(
    run_id: Annotated[
        str | None, typer.Argument(metavar="RUN", help="Id of a run; without it, the latest runs.")
    ] = None,
    watch: Annotated[
        bool, typer.Option("--watch", "-w", help="Follow the run to its end, then show its result.")
    ] = False,
    json_lines: Json = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Show the latest runs, or how far one is.

    With --watch the exit code is that of the run, as with `valerie run`.
    """
    from valerie.cli.connecting import System, client_of
    from valerie.cli.display import display_of, progress_table
    from valerie.cli.following import exit_code, failure_lines, follow, show_result

    with client_of(settings_of(data_dir), url) as client:
        if run_id is None:
            _list(list(client.runs()), as_json=json_lines)
            return
        run = client.run(run_id)
        title = f"{run.name} ({run.id})"
        if watch:
            system = System(client, owned=False, check=lambda: None)
            progress = follow(system, run.id, display_of(title, run.id, json_lines=json_lines))
            show_result(client, run.id, progress, None, json_lines=json_lines)
            raise typer.Exit(exit_code(progress.state))
        progress = client.progress(run_id)
        if json_lines:
            document = {"run": run.id, "name": run.name, **progress.model_dump(mode="json")}
            typer.echo(json.dumps(document, ensure_ascii=False))
            return
        out = console()
        out.print(progress_table(title, progress))
        if any(stage.failed for stage in progress.stages.values()):
            for line in failure_lines(client.failures(run_id)):
                out.print(line, style="red")


def report(
    run_id: RunId,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write.", show_default="reports/ beside the data folder"),
    ] = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Fetch the self-contained HTML report of an ended run; prints its path."""
    from valerie.cli.connecting import client_of
    from valerie.cli.following import report_path, save_report

    settings = settings_of(data_dir)
    with client_of(settings, url) as client:
        path = output or report_path(settings, client.run(run_id).name, run_id)
        typer.echo(save_report(client, run_id, path))


def cancel(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Stop a run; what is done stays, and `resume` lets it go on."""
    _steer("cancel", run_id, url, data_dir)


def resume(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Let a paused or cancelled run go on."""
    _steer("resume", run_id, url, data_dir)


def retry(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Try again what failed for good in a run."""
    _steer("retry", run_id, url, data_dir)


def delete(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Delete an ended run; `valerie gc` frees what no other run needs."""
    from valerie.cli.connecting import client_of

    with client_of(settings_of(data_dir), url) as client:
        client.delete(run_id)
    gc = _again("gc", data_dir=data_dir)
    say(f"run {run_id} is deleted; `{gc}` frees what no other run needs")


def _steer(action: str, run_id: str, url: str | None, data_dir: Path | None) -> None:
    from valerie.cli.connecting import client_of

    with client_of(settings_of(data_dir), url) as client:
        actions = {"cancel": client.cancel, "resume": client.resume, "retry": client.retry}
        run = actions[action](run_id)
    say(f"run {run.id} is {run.state}" + (f": {run.reason}" if run.reason else ""))


def _bind_to_parent(wanted: bool) -> None:
    """End with whoever started this command, e.g. ``make``, also when that is killed."""
    if wanted:
        from valerie.embedded.guard import end_with_parent

        end_with_parent()


def _leave(system: System, run_id: str, stopped: Stopped, data_dir: Path | None) -> None:
    """Somebody wants this command to end while its run goes on."""
    import signal

    from valerie.errors import ValerieError

    if not system.owned:
        follow = _again("status", run_id, "--watch", data_dir=data_dir)
        say(f"\nrun {run_id} goes on in the server; follow it with: {follow}")
        return
    if stopped.signum != signal.SIGINT:
        say(f"\nrun {run_id} goes on with the next `{command_name()} up` or `run` on this data folder")
        return
    try:  # an interrupted run shall not take the time of the next one
        system.client.cancel(run_id)
    except ValerieError as error:
        say(f"\nrun {run_id} could not be cancelled: {error}")
    else:
        say(f"\nrun {run_id} is cancelled; the same command makes only what is missing")


def _show_next(system: System, spec: Path, text: bytes, *, functions: str | None, data_dir: Path | None) -> None:
    from rich.table import Table
    from rich.text import Text

    dashboard = f"{system.client.url}/dashboard/"
    table = Table.grid(padding=(0, 1))
    table.add_row(
        "Dashboard", Text(f"{_again('up', data_dir=data_dir)}  then {dashboard}" if system.owned else dashboard)
    )
    if str(spec) != "-":
        table.add_row("Try next", Text(next_step(spec, text, functions=functions, data_dir=data_dir)))
    console().print(table)


def next_step(spec: Path, text: bytes, *, functions: str | None, data_dir: Path | None) -> str:
    """A change to a spec file that costs little, and the command that was just given, to run it again."""
    from valerie.runs.spec import parse

    dusk = "{name: dusk, exposure_ev: -2}"
    has_sensors = "sensors" in parse(text).model_fields_set
    # The first of the two is what the run had so far.
    line = f"sensors: [{{name: day}}, {dusk}]"
    change = f"add  {dusk}  to the sensors in {spec}" if has_sensors else f"add the line  {line}  to {spec}"
    command = ["run", str(spec), *([] if functions is None else ["--functions", functions])]
    return (
        f"{change}; then {_again(*command, data_dir=data_dir)}\n"
        "renders nothing: the functions only look again, at darker pictures"
    )


def _again(*command: str, data_dir: Path | None, url: str | None = None) -> str:
    """A command line on the same data folder or server, to be copied."""
    import shlex

    where = [*([] if url is None else ["--url", url]), *([] if data_dir is None else ["--data-dir", str(data_dir)])]
    return f"{command_name()} " + shlex.join([*command, *where])


def _list(found: list[Run], *, as_json: bool) -> None:
    if as_json:
        for run in found:
            typer.echo(run.model_dump_json())
        return
    if not found:
        say(f"no runs yet; start one with: {command_name()} run SPEC")
        return
    from datetime import datetime

    from rich.table import Table

    from valerie.runs.moments import moment_text

    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("run", no_wrap=True)
    table.add_column("name", overflow="fold")
    table.add_column("state", no_wrap=True)
    table.add_column("variants", justify="right", no_wrap=True)
    table.add_column("created", no_wrap=True)
    for run in found:
        created = moment_text(datetime.fromisoformat(run.created_at))
        table.add_row(run.id, run.name, run.state, f"{run.variant_count:,}", created)
    out = console()
    out.print(table)
    for run in found:
        if run.reason:
            out.print(f"{run.id}: {run.reason}", style="yellow")


def _print(document: dict[str, object], text: str, *, as_json: bool) -> None:
    typer.echo(json.dumps(document, ensure_ascii=False) if as_json else text)
