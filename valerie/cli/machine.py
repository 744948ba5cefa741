"""Commands that work on this machine: run a worker, replay a frame, free storage, migrate the database."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.access import COMMAND
from valerie.cli.shell import AsJson, DataDir, Exit, print_json, recorded
from valerie.errors import Conflict, InvalidInput, UnknownName
from valerie.local.deployment import context_of, create_or_migrate, folder_context, settings_of
from valerie.local.terminal import console
from valerie.plain import JsonObject
from valerie.runs.products.frame_keys import FrameKey

if TYPE_CHECKING:
    from valerie.pipeline.work.replay import Replayed
    from valerie.settings import Settings

IdleSeconds = Annotated[
    float | None,
    typer.Option(
        "--idle",
        min=0,
        max=86_400,
        help="End after this many seconds without work. Such a worker polls the database and needs no broker.",
        show_default=False,
    ),
]


def worker(
    stage: Annotated[str, typer.Argument(metavar="render|infer|eval", help="Stage of the worker.")],
    engines: Annotated[
        str | None,
        typer.Option(
            "--engines", help="Engines that a render worker offers, e.g. cycles; by default VALERIE_RENDER_ENGINES."
        ),
    ] = None,
    idle: IdleSeconds = None,
    data_dir: DataDir = None,
) -> None:
    """Run one worker process on this machine.

    Joins the server that `valerie up` runs on the same data folder, or the one that
    VALERIE_DATABASE_URL, VALERIE_BROKER_URL and VALERIE_ARTIFACTS_URL describe.
    """
    from valerie import plugins
    from valerie.embedded.guarded_process import python_command
    from valerie.embedded.supervisor import WORKERS, service_environment

    if stage not in WORKERS:
        raise UnknownName("stage", stage, WORKERS, field="render|infer|eval")
    settings = settings_of(data_dir)
    if engines is not None:
        if stage != "render":
            raise InvalidInput("only a render worker takes engines", field="--engines", value=engines)
        for engine in engines.split(","):
            plugins.require_renderer(engine, field="--engines")
        settings = settings.model_copy(update={"render_engines": engines})
    if idle is not None:
        settings = settings.model_copy(update={"worker_idle_seconds": idle})
    settings = _joined(settings)
    command = python_command(WORKERS[stage])
    # This process becomes the worker, so that signals and the exit status are the worker's.
    os.execve(command[0], list(command), service_environment(stage, settings))  # noqa: S606


def _joined(settings: Settings) -> Settings:
    """Return the settings with the broker of the server that `valerie up` runs on the data folder, unless they name one."""
    from valerie.embedded import running

    server = running.find(settings.data_dir)
    if server is None or "broker_url" in settings.model_fields_set:
        return settings
    return settings.model_copy(update={"broker_url": server.broker_url})


def replay(
    frame: Annotated[
        str,
        typer.Argument(
            metavar="FRAME", help="Id of a frame, as in the API and the dashboard: run.variant.camera.time."
        ),
    ],
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Recompute all products of a frame on this machine, and compare them byte for byte with the stored ones.

    Exits with 3 if any differs.
    """
    key = FrameKey.parse(frame, field="FRAME")
    with context_of(data_dir) as context:
        from valerie.pipeline.work.replay import replay_frame

        products = replay_frame(context, key)
    if as_json:
        for product in products:
            print_json(_document(product))
    else:
        _show(products)
    if not all(product.agrees for product in products):
        raise typer.Exit(Exit.COMPLETED_WITH_FAILURES)


def gc(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show what would be removed.")] = False,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Remove products that no run links to or keeps, and orphaned objects; beside running work."""
    with context_of(data_dir) as context:
        from valerie.pipeline.control.gc import collect

        with nullcontext() if dry_run else recorded(context, "gc"):
            space = collect(context, dry_run=dry_run)
    if as_json:
        print_json({"products": space.products, "objects": space.objects, "bytes": space.bytes})
        return
    verb = "would remove" if dry_run else "removed"
    typer.echo(
        f"{verb} {space.products:,} products that no run needs, and {space.objects:,} orphaned objects "
        f"({space.bytes / 1e6:,.1f} MB)"
    )


def migrate(data_dir: DataDir = None) -> None:
    """Migrate the database to this version; `run`, `up` and the API do so themselves."""
    from sqlalchemy.engine import make_url

    settings = settings_of(data_dir)
    create_or_migrate(settings)
    typer.echo(f"up to date: {make_url(settings.database_url).render_as_string()}")


def doctor(as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """Diagnose a deployment and say how to fix it. Exits with 5 if anything is wrong."""
    with context_of(data_dir) as context:
        from valerie.broker import Broker
        from valerie.embedded import running
        from valerie.pipeline.control.diagnosis import diagnose

        settings = context.settings
        local = context.engine.dialect.name == "sqlite" and "broker_url" not in settings.model_fields_set
        serverless = local and running.find(settings.data_dir) is None
        checks = diagnose(replace(context, broker=Broker(_joined(settings))), serverless=serverless)
    if as_json:
        print_json([asdict(check) for check in checks])
    else:
        for check in checks:
            mark, text = ("wrong", check.problem) if check.problem else ("ok", check.state)
            typer.echo(f"{mark:<6} {check.part}: {text}" + (f"\n       → {check.remedy}" if check.problem else ""))
    if any(check.problem for check in checks):
        raise typer.Exit(Exit.ENVIRONMENT)


def backup(
    folder: Annotated[Path, typer.Argument(help="A new folder.")],
    products: Annotated[
        bool, typer.Option("--products", help="Include products, which are otherwise computed again when needed.")
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Back up database, functions and results into a folder, while work continues.

    Your own assets are not part of it: back up their folder, too.
    """
    with context_of(data_dir) as context:
        from valerie.pipeline.control.backup import back_up

        contents = back_up(context, folder, products=products)
    typer.echo(f"{folder}: {contents.database} and {contents.objects:,} objects ({contents.bytes / 1e6:,.1f} MB)")


def restore(folder: Annotated[Path, typer.Argument(help="A folder of `backup`.")], data_dir: DataDir = None) -> None:
    """Restore a backup into an empty deployment, which the settings describe."""
    from valerie.pipeline.control.backup import restore as restore_backup

    contents = restore_backup(settings_of(data_dir), folder)
    typer.echo(f"restored {contents.database} and {contents.objects:,} objects of {contents.software}")


def archive(
    runs: Annotated[list[str] | None, typer.Argument(metavar="RUN…", help="Ids of runs that have ended.")] = None,
    older_than: Annotated[
        int | None, typer.Option("--older-than", metavar="DAYS", min=0, help="All runs that ended so many days ago.")
    ] = None,
    undo: Annotated[bool, typer.Option("--undo", help="Move the rows of archived runs back.")] = False,
    data_dir: DataDir = None,
) -> None:
    """Move the rows of ended runs from the database into the artifact store, as Parquet.

    Everything that reads a run reads an archived one as before. It is deleted like others; other changes need `--undo`.
    """
    from valerie.pipeline.control import archiving

    if bool(runs) == (older_than is not None) or (undo and not runs):
        limit = "RUN… or --older-than DAYS; RUN… --undo"
        raise InvalidInput("name the runs, or say how old they are", field="RUN, --older-than", limit=limit)
    with context_of(data_dir) as context:
        for run in runs or archiving.ended_runs(context, days=older_than or 0):
            if undo:
                with recorded(context, f"archive --undo {run}"):
                    archiving.restore_rows(context, run)
                typer.echo(f"run {run} is not archived")
                continue
            try:
                with recorded(context, f"archive {run}"):
                    tables = archiving.archive_run(context, run).tables.values()
            except Conflict as error:
                if runs:
                    raise
                typer.echo(f"left: {error}")
                continue
            size = sum(table.bytes for table in tables) / 1e6
            typer.echo(f"archived run {run}: {sum(table.rows for table in tables):,} rows, {size:,.1f} MB")


def audit(as_json: AsJson = False, data_dir: DataDir = None) -> None:
    """Print the audit log of the API: who asked for which change, when, and the status of the answer, or a command's exit code.

    Nobody can change or delete its rows. With `--json`, each line is one row.
    """
    from valerie.db.audit import entries
    from valerie.db.engine import reading
    from valerie.runs.moments import moment_text

    with context_of(data_dir) as context, reading(context.engine) as connection:
        for number, entry in entries(connection):
            if as_json:
                print_json({"number": number, **asdict(entry), "at": entry.at.isoformat()})
                continue
            who = (entry.owner if entry.caller == COMMAND else entry.caller) or "nobody"
            outcome = "…" if entry.status is None else entry.status
            more = f" ({entry.left_out:,} refusals before it were left out)" if entry.left_out else ""
            typer.echo(
                f"{moment_text(entry.at)} {entry.request} {outcome!s:<3} {who} from {entry.address}: "
                f"{entry.method} {entry.path}{more}"
            )


def copy(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id of a run that has ended.")],
    to: Annotated[Path | None, typer.Option("--to", help="Data folder to copy it to, new or not.")] = None,
    source: Annotated[Path | None, typer.Option("--from", help="Data folder to copy it from.")] = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Copy a run with its products, functions and results to a data folder, or from one into this deployment.

    Every command works on the copy: `valerie up --data-dir FOLDER` shows it. Your own assets are not part of it.
    """
    from valerie.cli.progress_lines import ProgressLines
    from valerie.pipeline.control.copy_run import copy_run

    if (to is None) == (source is None):
        raise InvalidInput(
            "a copy goes to one data folder or comes from one", field="--to, --from", limit="one of both"
        )
    lines = ProgressLines("objects")
    with ExitStack() as stack:
        if source is not None:
            first = stack.enter_context(folder_context(source, create=False))
            create_or_migrate(settings_of(data_dir))
            second = stack.enter_context(context_of(data_dir))
        else:
            assert to is not None
            first = stack.enter_context(context_of(data_dir))
            second = stack.enter_context(folder_context(to, create=True))
        with recorded(second, f"copy {run}"):
            copy = copy_run(first, second, run, progress=lines.tell)
    if as_json:
        typer.echo(copy.model_dump_json())
    else:
        typer.echo(f"copied run {run} with {copy.objects:,} objects ({copy.bytes / 1e6:,.1f} MB)")


def _document(product: Replayed) -> JsonObject:
    return {
        "kind": product.kind,
        "name": product.name,
        "digest": product.digest,
        "verdict": product.verdict,
        "equal": product.agrees,
        "cpu_seconds": round(product.cpu_seconds, 4),
        "details": product.details,
    }


def _show(products: list[Replayed]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("product", "function / sensor", "compared with the stored one"):
        table.add_column(column)
    table.add_column("CPU", justify="right")
    for product in products:
        verdict = Text(product.verdict, "green" if product.agrees else "bold red")
        table.add_row(product.kind, product.name, verdict, f"{product.cpu_seconds:.2f} s")
    console().print(table)
    sys.stdout.flush()
