"""Commands about studies, and the refinement of a run."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.shell import (
    AsJson,
    DataDir,
    Exit,
    ReportFile,
    ReportOfRun,
    RunId,
    Stopped,
    Url,
    decide,
    print_json,
    say,
    write_output,
    write_template,
)
from valerie.errors import InvalidInput, NotFound, UnknownName
from valerie.local.deployment import settings_of
from valerie.local.spec_files import read_spec
from valerie.local.terminal import command_name, console

if TYPE_CHECKING:
    from valerie.answers import NextBatch, Study
    from valerie.cli.connecting import System
    from valerie.runs.study.study_document import Budget

app = typer.Typer(
    no_args_is_help=True,
    help="Answer a question within a budget: a study proposes and runs batches of variants, decides, and explains.",
)

StudyFile = Annotated[Path, typer.Argument(metavar="FILE", help="Study as YAML or JSON; - reads standard input.")]
StudyId = Annotated[str, typer.Argument(metavar="STUDY", help="Id of a study, as `valerie study status` lists it.")]
Count = Annotated[
    int | None, typer.Option("--count", min=1, help="Another number of variants; the strategy proposes anew.")
]

_POLL_SECONDS = 0.5


@app.command()
def new(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="File to write; - prints it.")] = Path("study.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Write a commented study to start from."""
    write_template("valerie.studies", path, force=force, then="study plan")


@app.command()
def plan(file: StudyFile, as_json: AsJson = False, url: Url = None, data_dir: DataDir = None) -> None:
    """Show the first batch of a study and its price, without storing anything."""
    from valerie.answers import NextBatch
    from valerie.cli.connecting import client_of
    from valerie.embedded import running
    from valerie.runs.study.study_document import CascadeGoal, parse_study

    settings = settings_of(data_dir)
    text = read_spec(file)
    document = parse_study(text)
    if url is not None or running.find(settings.data_dir) is not None:
        with client_of(settings, url) as client:
            batch = client.plan_study(text)
    else:
        from pydantic import TypeAdapter

        from valerie.local.deployment import deployment_or_empty
        from valerie.pipeline.control.studies.commands import plan_study

        with deployment_or_empty(settings) as context:
            first = plan_study(context, document)
        batch = NextBatch.model_validate(TypeAdapter(type(first)).dump_python(first, mode="json"))
    _show_next(batch, as_json=as_json)
    if as_json or not batch.legal:
        return
    if isinstance(document.goal, CascadeGoal):
        typer.echo("\nbatches by the costly engine cost more: each is priced when it is proposed")
    else:
        _show_budget(batch, document.budget)


def _show_budget(first: NextBatch, budget: Budget) -> None:
    """Print the price of a study that spends its variants, from that of its first batch, and a warning if it is too high."""
    from valerie.runs.forecasting.plan import Plan
    from valerie.runs.moments import duration

    plan = Plan.model_validate(first.plan)
    each = (plan.cpu_seconds - plan.start_cpu_seconds) / first.legal
    seconds = plan.start_cpu_seconds + each * budget.variants
    typer.echo(f"\nthe budget of {budget.variants:,} variants: about {duration(seconds)} of CPU time at this price")
    if budget.cpu_hours is not None and seconds > 3600 * budget.cpu_hours:
        within = max(int((3600 * budget.cpu_hours - plan.start_cpu_seconds) / each), 0)
        typer.echo(f"warning: budget.cpu_hours: {budget.cpu_hours:g} hours pay for about {within:,} variants")


@app.command()
def run(
    file: StudyFile,
    by_hand: Annotated[
        bool, typer.Option("--by-hand", help="Wait before each batch for `valerie study accept`.")
    ] = False,
    report: ReportOfRun = None,
    retrain: Annotated[
        bool,
        typer.Option("--retrain", help="If the requirement is not met, find failures, train on them and verify again."),
    ] = False,
    until_met: Annotated[
        bool, typer.Option("--until-met", help="With --retrain: repeat as often as `rounds` and the budget allow.")
    ] = False,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Run a study on this machine to its end, and write its report.

    Uses the server that runs on the data folder, or starts one that ends with this command. After Ctrl-C,
    `valerie study run STUDY` with the id of the study, or `valerie up`, continues it. With --retrain, the same
    command continues.
    """
    if until_met and not retrain:
        raise InvalidInput("without a new version, the verdict stays", field="--until-met", limit="with --retrain")
    if retrain:
        _go_round(file, once=not until_met, report=report, as_json=as_json, data_dir=data_dir)
        return
    from valerie.cli.connecting import own_assets, system_of
    from valerie.cli.following import report_path
    from valerie.runs.study.study_document import StudyState, parse_study

    settings = settings_of(data_dir)
    known = None if file.exists() or str(file) == "-" else str(file)
    if known:
        _check_stored(known, data_dir)
    else:
        text = read_spec(file)
        document = parse_study(text)
        if by_hand:  # in the document, so that no batch starts before it is said
            text = document.model_copy(update={"mode": "by hand"}).to_yaml().encode()
    with system_of(settings) as system:
        client = system.client
        if known:
            study = client.study(known)
            if study.state == StudyState.PAUSED:
                study = client.resume_study(known)
        else:
            with own_assets(settings, client):
                study = client.begin_study(text)
        if by_hand and not study.by_hand:
            study = client.set_study_mode(study.id, by_hand=True)
        say(f"study {study.id}: {client.url}/dashboard/#/studies/{study.id}")
        try:
            study = follow_study(system, study.id, quiet=as_json)
        except Stopped:
            say(f"\nstudy {study.id} is interrupted; {_continued(study.id)}")
            raise
        path = report or report_path(settings, study.name, study.id)
        page = client.study_report(study.id)
    write_output(path, page)
    _show(study, as_json=as_json)
    if study.state != "finished":
        raise typer.Exit(Exit.NOT_COMPLETED)


def _check_stored(name: str, data_dir: Path | None) -> None:
    """Refuse what is neither a file nor a study, before anything is started."""
    from valerie.cli.connecting import source_of

    try:
        with source_of(data_dir, None) as source:
            source.study(name)
    except NotFound:
        raise InvalidInput("neither a file nor the id of a study", field="FILE", value=name) from None


def _continued(study_id: str) -> str:
    return f"continue it with: {command_name()} study run {study_id}"


def _go_round(file: Path, *, once: bool, report: Path | None, as_json: bool, data_dir: Path | None) -> None:
    """Verify, find, train and verify again; rewrite the report after every stage."""
    from valerie.cli.connecting import own_assets, system_of
    from valerie.cli.training import Steps, say_site
    from valerie.local.deployment import context_of
    from valerie.pipeline.retraining.retrain import Watcher
    from valerie.pipeline.rounds.flow import FlowEnd, Surroundings, check_flow, until_met
    from valerie.pipeline.rounds.flow_reporting import flow_report
    from valerie.runs.study.study_document import parse_study
    from valerie.spelling import plain_name

    settings = settings_of(data_dir)
    document = parse_study(read_spec(file))
    if once:
        document = document.model_copy(update={"rounds": document.rounds.model_copy(update={"most": 1})})
    check_flow(document)
    folder = settings.data_dir.parent
    path = report or folder / "reports" / f"{plain_name(document.name, longest=60).lower() or 'flow'}-flow.html"
    with system_of(settings) as system, own_assets(settings, system.client), context_of(data_dir) as context:

        def wait(study_id: str) -> None:
            say(f"study {study_id}: {system.client.url}/dashboard/#/studies/{study_id}")
            follow_study(system, study_id, quiet=as_json)

        around = Surroundings(wait, folder / "training", watcher=Watcher(say_site, Steps()))
        for flow in until_met(context, document, around):
            write_output(path, flow_report(context, flow).encode())
    code = decide(Exit.OK if flow.ending is FlowEnd.MET else Exit.GATE_FAILED)
    if as_json:
        rounds = [
            (each.function, None if each.verification is None else each.verification.outcome) for each in flow.rounds
        ]
        print_json({"outcome": flow.outcome, "ending": flow.ending, "rounds": rounds})
    else:
        say(f"the requirement is {flow.outcome} after {len(flow.rounds)} round{'s' if len(flow.rounds) > 1 else ''}")
    raise typer.Exit(code)


@app.command()
def submit(file: StudyFile, url: Url = None, data_dir: DataDir = None) -> None:
    """Begin a study on a running server, and print its id."""
    from valerie.cli.connecting import client_of, own_assets

    settings = settings_of(data_dir)
    text = read_spec(file)
    with client_of(settings, url) as client, own_assets(settings, client):
        typer.echo(client.begin_study(text).id)


@app.command()
def status(
    study_id: Annotated[
        str | None, typer.Argument(metavar="STUDY", help="Id of a study; without it, the latest studies.")
    ] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Show the latest studies, or one with its batches, its cost and its result so far. Needs no server."""
    from valerie.cli.connecting import source_of
    from valerie.local.display import progress_line
    from valerie.local.folder import Folder
    from valerie.runs.study.study_document import StudyState

    with source_of(data_dir, url) as source:
        if study_id is not None:
            study = source.study(study_id)
            _show(study, as_json=as_json)
            if as_json or study.state != StudyState.RUNNING:
                return
            for number, run_id in _open_runs(study):
                typer.echo(progress_line(f"batch {number}", source.progress(run_id)))
            if isinstance(source, Folder):
                say(f"no server runs on the data folder, so the study waits; {_continued(study.id)}")
            return
        listed = list(source.studies())
    if as_json:
        for study in listed:
            typer.echo(study.model_dump_json())
        return
    if not listed:
        say(f"no studies yet; begin with: {command_name()} study new")
    for study in listed:
        why = f": {study.reason}" if study.reason else ""
        typer.echo(f"{study.id}  {study.goal:<10} {study.name}  {study.state}{why}")


@app.command(name="next")
def next_batch(
    study_id: StudyId,
    spec: Annotated[
        Path | None,
        typer.Option("--spec", metavar="FILE", help="Also write the spec of its run, for a run of your own."),
    ] = None,
    as_json: AsJson = False,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Show the newest open batch of a study: why these variants, and their price."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        batch = client.next_batch(study_id)
    if spec is not None:
        write_output(spec, batch.spec.encode())
    _show_next(batch, as_json=as_json)


@app.command()
def accept(study_id: StudyId, count: Count = None, url: Url = None, data_dir: DataDir = None) -> None:
    """Accept the proposed batch of a study by hand."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        _say(client.accept_batch(study_id, count=count))


@app.command()
def mode(
    study_id: StudyId,
    how: Annotated[str, typer.Argument(metavar="MODE", help="automatic, or by-hand, as `mode` in the document.")],
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Let a study run by itself, or ask before each batch."""
    from valerie.cli.connecting import client_at

    by_hand = how.replace(" ", "-") == "by-hand"
    if not by_hand and how != "automatic":
        raise UnknownName("mode", how, ("automatic", "by-hand"), field="MODE")
    with client_at(url, data_dir) as client:
        _say(client.set_study_mode(study_id, by_hand=by_hand))


@app.command()
def stop(study_id: StudyId, url: Url = None, data_dir: DataDir = None) -> None:
    """End a study now, with its result so far; its runs are cancelled."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        _say(client.stop_study(study_id))


@app.command()
def resume(study_id: StudyId, url: Url = None, data_dir: DataDir = None) -> None:
    """Continue a paused study; failed products are tried again."""
    from valerie.cli.connecting import client_at

    with client_at(url, data_dir) as client:
        _say(client.resume_study(study_id))


@app.command()
def report(
    study_id: StudyId,
    output: ReportFile = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write the self-contained HTML report of a study, with its result so far. Needs no server."""
    from valerie.cli.connecting import source_of
    from valerie.cli.following import report_path

    with source_of(data_dir, url) as source:
        path = output or report_path(settings_of(data_dir), source.study(study_id).name, study_id)
        write_output(path, source.study_report(study_id))


def follow_study(system: System, study_id: str, *, quiet: bool) -> Study:
    """Print the steps of a study, and the progress of its oldest open batch, until it ends or is paused."""
    from valerie.local.display import Display, display_of
    from valerie.runs.study.study_document import StudyState

    printed: set[str] = set()
    display: tuple[str, Display] | None = None

    def tell(line: str) -> None:
        if line not in printed and not quiet:
            say(line)
        printed.add(line)

    with ExitStack() as shown:
        while True:
            system.check()
            study = system.client.study(study_id)
            for batch in study.batches:
                tell(f"batch {batch.number + 1}: {batch.reason}")
                if batch.run_id:
                    tell(f"batch {batch.number + 1}: {batch.legal} variants in run {batch.run_id}")
                if batch.outcomes is not None and study.result is not None:
                    for sentence in study.result.sentences[:1]:
                        tell(f"  {sentence}")
            if study.reason and study.state == StudyState.RUNNING:
                proposed = any(batch.accepted_at is None for batch in study.batches)
                tell(study.reason + (f": {command_name()} study accept {study_id}" if proposed else ""))
            if study.state != StudyState.RUNNING:
                return study
            for number, run_id in () if quiet else _open_runs(study)[:1]:
                if display is None or display[0] != run_id:
                    shown.close()
                    display = run_id, shown.enter_context(display_of(f"batch {number}", run_id, json_lines=False))
                display[1].update(system.client.progress(run_id))
            time.sleep(_POLL_SECONDS)


def _open_runs(study: Study) -> list[tuple[int, str]]:
    """Return number, from 1, and run of each batch that is in work, oldest first."""
    return [(batch.number + 1, batch.run_id) for batch in study.batches if batch.run_id and batch.outcomes is None]


def _show(study: Study, *, as_json: bool) -> None:
    from valerie.runs.moments import duration

    if as_json:
        typer.echo(study.model_dump_json())
        return
    from rich.table import Table

    out = console()
    out.print(f"{study.name} ({study.id}), {study.goal}: {study.state}" + (f", {study.reason}" if study.reason else ""))
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("batch", "run", "variants", "ended", "CPU time", "why"):
        table.add_column(name, justify="right" if name in ("batch", "variants", "CPU time") else "left")
    for batch in study.batches:
        state = "yes" if batch.outcomes is not None or not batch.run_id else "no"
        state = "proposed" if batch.accepted_at is None else state
        cost = "" if batch.cpu_seconds is None else duration(batch.cpu_seconds)
        table.add_row(str(batch.number + 1), batch.run_id or "", str(batch.legal), state, cost, batch.reason)
    out.print(table)
    if study.result is None:
        out.print("The study ended without a result." if study.state in ("finished", "stopped") else "No result yet.")
    for sentence in () if study.result is None else study.result.sentences:
        out.print(sentence)
    if study.outlook:
        out.print(study.outlook)


def _show_next(batch: NextBatch, *, as_json: bool) -> None:
    if as_json:
        typer.echo(batch.model_dump_json(indent=1))
        return
    from valerie.cli.specs import show_plan
    from valerie.runs.forecasting.plan import Plan

    rejections = f", {batch.rejected} rejected" if batch.rejected else ""
    where = f", in work as run {batch.run_id}" if batch.run_id else ""
    typer.echo(f"batch {batch.number + 1}: {batch.reason} {batch.legal} variants{rejections}{where}.\n")
    show_plan(Plan.model_validate(batch.plan))


def _say(study: Study) -> None:
    say(f"study {study.id} is {study.state}" + (f": {study.reason}" if study.reason else ""))


def refine(
    run_id: RunId,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="File to write.", show_default="printed")
    ] = None,
    where: Annotated[
        str | None,
        typer.Option("--where", metavar="EXPRESSION", help="Refine around the rows that satisfy this expression."),
    ] = None,
    finding: Annotated[
        int | None,
        typer.Option("--finding", min=1, metavar="N", help="A finding or candidate, by its number in the report."),
    ] = None,
    requirement: Annotated[
        str | None, typer.Option("--requirement", metavar="ID", help="A requirement: the rows that miss it.")
    ] = None,
    add: Annotated[
        list[str] | None, typer.Option("--add", metavar="PARAMETER", help="Also vary this, over its declared range.")
    ] = None,
    drop: Annotated[
        list[str] | None, typer.Option("--drop", metavar="PARAMETER", help="Stop varying this; it gets a constant.")
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Write the next spec from a run: half the steps, inside the region of the selected rows.

    Without a selection, the whole run is refined. Needs no server.
    """
    from valerie.local.deployment import context_of
    from valerie.pipeline.control.refine import RefinedPart, refine_run

    with context_of(data_dir) as context:
        text, region = refine_run(
            context, run_id, RefinedPart(where, finding, requirement), add=add or (), drop=drop or ()
        )
    if region:
        say(f"region: {region}")
    if output is None:
        typer.echo(text, nl=False)
    else:
        write_output(output, text.encode())
