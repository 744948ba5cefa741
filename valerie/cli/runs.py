"""Commands that start, follow and control runs."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator, Mapping, Sequence
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
    RunId,
    RunIds,
    Stopped,
    Url,
    require_format,
    say,
    write_output,
)
from valerie.cli.specs import Functions, resolvable, spec_text
from valerie.errors import InvalidInput
from valerie.local.deployment import settings_of
from valerie.local.terminal import command_name, console
from valerie.runs.products.states import Priority

if TYPE_CHECKING:
    import pyarrow as pa

    from valerie.analysis.claims.claims import Claims
    from valerie.analysis.comparison.beside import Beside
    from valerie.cli.connecting import System
    from valerie.client import Client, Run
    from valerie.pipeline.reading.reports import ReportWith

_UNITS: Final = {"min": timedelta(minutes=1), "h": timedelta(hours=1), "d": timedelta(days=1)}

SpecFile = Annotated[Path, typer.Argument(metavar="SPEC", help="YAML or JSON file; - reads standard input.")]


def run(
    spec: SpecFile,
    functions: Functions = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", help="File for the report.", show_default="reports/ next to the data folder"),
    ] = None,
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
    from valerie.cli.shell import save
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
            answered = _report_with([run.id], statements, None, data_dir)
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
    from valerie.cli.connecting import System, client_of, source_of
    from valerie.cli.following import exit_code, failure_lines, follow, show_result, show_verdicts
    from valerie.local.display import display_of, progress_table

    if watch and run_id is not None:
        with client_of(settings_of(data_dir), url) as client:
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
            document = {"run": run.id, "name": run.name, **progress.model_dump(mode="json")}
            typer.echo(json.dumps(document, ensure_ascii=False))
            return
        out = console()
        show_verdicts(source, run_id, progress)
        out.print(progress_table(f"{run.name} ({run_id})", progress))
        if any(stage.failed for stage in progress.stages.values()):
            for line in failure_lines(source.failures(run_id)):
                out.print(line, style="red")


def report(
    run_ids: RunIds,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write.", show_default="reports/ next to the data folder"),
    ] = None,
    claims: Annotated[
        Path | None,
        typer.Option("--claims", metavar="FILE", help="Also test these claims, such as examples/claims/paper.yaml."),
    ] = None,
    beside: Annotated[
        str | None,
        typer.Option(
            "--beside",
            metavar="RUN|FILE.json",
            help="Show a comparison with another run of the same scenes, such as one in Cycles, or one that `compare` wrote.",
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures",
            metavar="FOLDER",
            help="Also write the numbers of its figures: a .csv and a .parquet each.",
        ),
    ] = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write the self-contained report of an ended run to a file, and print its path. Needs no server.

    Several runs, such as of one grid on several sites, get one report together. That of several runs, or with
    --claims, --beside or --figures, is rebuilt from the data folder. Chromium prints it if the file is FILE.pdf.
    """
    from valerie.cli.claims import read_claims
    from valerie.cli.connecting import source_of
    from valerie.cli.following import report_path
    from valerie.cli.shell import save

    written = len(run_ids) == 1 and (claims, beside, figures) == (None, None, None)
    if url is not None and not written:
        problem = "several runs, --claims, --beside and --figures read the data folder"
        raise InvalidInput(problem, field="--url", value=url, limit="--data-dir")
    with source_of(data_dir, url) as source:
        path = output or report_path(settings_of(data_dir), source.run(run_ids[0]).name, run_ids[0])
        if written:
            content = source.report(run_ids[0])
        else:
            statements = None if claims is None else read_claims(claims)
            rebuilt = _report_with(run_ids, statements, beside, data_dir)
            content = rebuilt.html.encode()
            if figures is not None:
                _write_figures(rebuilt.figures, figures)
    if path.suffix == ".pdf":
        from valerie.cli.printing import pdf_of

        content = pdf_of(content)
    typer.echo(save(content, path))


def _write_figures(tables: Mapping[str, pa.Table], folder: Path) -> None:
    from valerie.analysis.rows.table import encoded

    for name, table in tables.items():
        for suffix in ("csv", "parquet"):
            write_output(folder / f"{name}.{suffix}", encoded(table, suffix))


def _report_with(
    run_ids: Sequence[str], claims: Claims | None, beside: str | None, data_dir: Path | None
) -> ReportWith:
    from valerie.local.deployment import context_of
    from valerie.pipeline.reading.reports import report_with

    with context_of(data_dir) as context:
        return report_with(context, *run_ids, claims=claims, other=_comparison(beside))


def _comparison(beside: str | None) -> str | Beside | None:
    """Return the id of a run as it is, and a comparison from its file."""
    if beside is None or not beside.endswith(".json"):
        return beside
    from valerie.analysis.comparison import beside as comparison
    from valerie.local.spec_files import read_spec

    return comparison.Beside.from_json(read_spec(Path(beside)))


@dataclass(frozen=True, slots=True)
class Sides:
    """The rows of a comparison."""

    functions: Annotated[
        list[str] | None,
        typer.Option(
            "--function",
            metavar="NAME",
            help="Twice: a function of RUN, and the one of OTHER (or RUN) to compare it with.",
        ),
    ] = None
    across: Annotated[
        list[str] | None,
        typer.Option(
            "--across",
            metavar="PARAMETER",
            help="Match frames that differ in this parameter, which each run holds at a value of its own, such as "
            "sun-1.elevation of a run by day and one at dusk; may be repeated.",
        ),
    ] = None
    where: Annotated[
        str,
        typer.Option(
            "--where", metavar="EXPRESSION", help='Only rows of RUN that satisfy this expression: "distance_m > 25".'
        ),
    ] = ""


@takes_documents
def compare(
    run_id: RunId,
    sides: Sides,
    other: Annotated[
        str | None, typer.Argument(metavar="[OTHER]", help="A run of the same scenes.", show_default=False)
    ] = None,
    claims: Annotated[
        Path | None, typer.Option("--claims", metavar="FILE", help="Also test these claims on both sides.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Also write FILE.html, the report of RUN with pictures; or the "
            "differences as FILE.csv, .parquet or .json.",
        ),
    ] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Compare two ended runs on their shared scenes, or two functions of one run.

    Prints paired differences of pACC by slice (distance, occlusion, character,
    camera, every varied parameter), rank correlation, and which conclusions hold
    on both sides. The report shows the worst regressions.
    """
    from valerie.cli.claims import read_claims
    from valerie.cli.comparing import contents, renderables
    from valerie.cli.datasets import counting
    from valerie.cli.shell import write_output
    from valerie.local.deployment import context_of
    from valerie.pipeline.reading.reports import compare_runs, report_with

    pair = _function_pair(other, sides.functions or [])
    require_format(output, (".html", ".csv", ".parquet", ".json"))
    statements = None if claims is None else read_claims(claims)
    with context_of(data_dir) as context:
        comparison = compare_runs(
            context, run_id, other or run_id,
            functions=pair, claims=statements, across=sides.across or (), where=sides.where, progress=counting("frames compared"),
        )  # fmt: skip
        if output is not None and output.suffix == ".html":
            html = report_with(context, run_id, claims=statements, other=comparison).html
            write_output(output, html.encode())
    if output is not None and output.suffix != ".html":
        write_output(output, contents(comparison, output.suffix))
    if as_json:
        typer.echo(json.dumps(comparison.to_json(), ensure_ascii=False))
        return
    for part in renderables(comparison):
        console().print(part)


def _function_pair(other: str | None, functions: list[str]) -> tuple[str, str] | None:
    """Return the functions to compare; None for all."""
    if len(functions) == 2:
        here, there = functions
        if other is None and here == there:
            raise InvalidInput("a function is compared with itself", field="--function", value=here)
        return here, there
    if functions or other is None:
        limit = "OTHER, a run of the same scenes; or --function A --function B"
        raise InvalidInput(
            "a comparison has two sides", field="--function", value=", ".join(functions) or None, limit=limit
        )
    return None


def cancel(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Stop a run. Finished products stay, and `resume` continues the run."""
    with _client(url, data_dir) as client:
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
    with _client(url, data_dir) as client:
        _say_state(client.retry(run_id))


def delete(run_id: RunId, url: Url = None, data_dir: DataDir = None) -> None:
    """Delete an ended run. `valerie gc` then removes products that no other run needs."""
    with _client(url, data_dir) as client:
        client.delete(run_id)
    gc = _command_line("gc", data_dir=data_dir)
    say(f"run {run_id} is deleted; `{gc}` removes products that no other run needs")


def mark(
    target: Annotated[str, typer.Argument(metavar="RUN|FRAME", help="Id of a run or of a frame.")],
    finding: Annotated[
        int | None, typer.Option("--finding", metavar="N", help="A finding or candidate, by its number in the report.")
    ] = None,
    tags: Annotated[list[str] | None, typer.Option("--tag", help="Add a tag; may be repeated.")] = None,
    untag: Annotated[list[str] | None, typer.Option("--untag", help="Remove a tag; may be repeated.")] = None,
    note: Annotated[str | None, typer.Option("--note", help="Replace the note; an empty text removes it.")] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Put tags and a note on a run, a frame or a finding; without options, show those of the run.

    They are for people: no spec, digest or result contains them. They are deleted with the run.
    """
    from valerie.analysis.findings.findings import Findings
    from valerie.client import Mark
    from valerie.plain import typed

    run_id, _, name = target.partition(".")
    with _client(url, data_dir) as client:
        marks = client.marks(run_id)
        kind = "frame" if name else "run"
        if finding is not None:
            findings = typed(Findings, client.summary(run_id).findings)
            kind, name = "finding", findings.numbered(finding).sentence
        if tags or untag or note is not None:
            present = next((mark for mark in marks if (mark.kind, mark.name) == (kind, name)), None)
            kept = set(present.tags if present else ()) - set(untag or ()) | set(tags or ())
            text = note if note is not None else present.note if present else ""
            marks = client.put_mark(run_id, Mark(kind=kind, name=name, tags=tuple(sorted(kept)), note=text))
    for mark in marks:
        if as_json:
            typer.echo(mark.model_dump_json())
        else:
            subject = run_id if mark.kind == "run" else f"{run_id}.{mark.name}" if mark.kind == "frame" else mark.name
            typer.echo(": ".join(part for part in (subject, ", ".join(mark.tags), mark.note) if part))


def _client(url: str | None, data_dir: Path | None) -> Client:
    from valerie.cli.connecting import client_of

    return client_of(settings_of(data_dir), url)


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

    Args:
        system: that works on the run.
        run: the run.
        report: file for its report.
        again: command that continues the run, if the user stops this one.
        data_dir: option of the command.
        json_lines: True prints JSON lines instead.
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
