"""Commands about this machine: one worker, one frame again, tidying up."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.deployment import context_of
from valerie.cli.shell import DataDir, Exit, Json, console, settings_of
from valerie.errors import InvalidInput, UnknownName
from valerie.runs.frames import FrameKey

if TYPE_CHECKING:
    from valerie.pipeline.work.replay import Replayed


def worker(
    stage: Annotated[str, typer.Argument(metavar="render|infer|eval", help="Which work it takes.")],
    engines: Annotated[
        str | None,
        typer.Option(
            "--engines", help="Engines that a render worker offers, e.g. cycles; default VALERIE_RENDER_ENGINES."
        ),
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Run one worker process here, for a server that runs elsewhere or by itself.

    Reads VALERIE_DATABASE_URL, VALERIE_BROKER_URL and VALERIE_ARTIFACTS_URL;
    where `valerie up` runs on the same data folder, it joins that server.
    """
    from valerie import plugins
    from valerie.embedded import running
    from valerie.embedded.process import python_command
    from valerie.embedded.supervisor import WORKERS, service_environment

    if stage not in WORKERS:
        raise UnknownName("stage", stage, WORKERS, field="render|infer|eval")
    settings = settings_of(data_dir)
    if engines is not None:
        if stage != "render":
            raise InvalidInput("only a render worker has engines", field="--engines", value=engines)
        for engine in engines.split(","):
            plugins.require_renderer(engine, field="--engines")
        settings = settings.model_copy(update={"render_engines": engines})
    found = running.find(settings.data_dir)
    if found is not None and "broker_url" not in settings.model_fields_set:
        settings = settings.model_copy(update={"broker_url": found.broker_url})
    command = python_command(WORKERS[stage])
    # This process becomes the worker: signals and exit status are the worker's own.
    os.execve(command[0], list(command), service_environment(stage, settings))  # noqa: S606


def replay(
    frame: Annotated[
        str,
        typer.Argument(metavar="FRAME", help="Id of a frame: run.variant.camera.time, as the API and dashboard show."),
    ],
    as_json: Json = False,
    data_dir: DataDir = None,
) -> None:
    """Render and infer one frame again here, and compare it byte for byte with what is stored.

    Exits with 3 when something differs.
    """
    key = FrameKey.parse(frame, field="FRAME")
    with context_of(data_dir) as context:
        from valerie.pipeline.work.replay import replay_frame

        made = replay_frame(context, key)
    if as_json:
        for one in made:
            typer.echo(json.dumps(_document(one), ensure_ascii=False))
    else:
        _show(made)
    if not all(one.agrees for one in made):
        raise typer.Exit(Exit.COMPLETED_WITH_FAILURES)


def gc(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be removed.")] = False,
    as_json: Json = False,
    data_dir: DataDir = None,
) -> None:
    """Free what no run links to: products, their objects, and objects that belong to nothing."""
    with context_of(data_dir) as context:
        from valerie.pipeline.control.gc import collect

        freed = collect(context, dry_run=dry_run)
    if as_json:
        typer.echo(json.dumps({"products": freed.products, "objects": freed.objects, "bytes": freed.bytes}))
        return
    word = "would remove" if dry_run else "removed"
    typer.echo(
        f"{word} {freed.products:,} products that no run needs, and {freed.objects:,} orphaned objects "
        f"({freed.bytes / 1e6:,.1f} MB)"
    )


def migrate(data_dir: DataDir = None) -> None:
    """Bring the database to this version's tables; `run`, `up` and the API do it by themselves."""
    from valerie.db.engine import open_engine
    from valerie.db.migrate import migrate as migrate_database

    settings = settings_of(data_dir)
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    engine = open_engine(settings.database_url)
    try:
        migrate_database(engine)
    finally:
        engine.dispose()
    typer.echo(f"up to date: {engine.url.render_as_string()}")


def _document(one: Replayed) -> dict[str, object]:
    return {
        "kind": one.kind,
        "name": one.name,
        "digest": one.digest,
        "verdict": one.verdict,
        "equal": one.agrees,
        "cpu_seconds": round(one.cpu_seconds, 4),
        "details": one.details,
    }


def _show(made: list[Replayed]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("product", "function / sensor", "compared with the stored one"):
        table.add_column(column)
    table.add_column("CPU", justify="right")
    for one in made:
        verdict = Text(one.verdict, "green" if one.agrees else "bold red")
        table.add_row(one.kind, one.name, verdict, f"{one.cpu_seconds:.2f} s")
    console().print(table)
    sys.stdout.flush()
