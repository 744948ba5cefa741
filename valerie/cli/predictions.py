"""The command that uploads predictions; `valerie.cli.frames` exports the frames to predict."""

from __future__ import annotations

from http import HTTPStatus
from pathlib import Path
from typing import Annotated

import typer

from valerie.cli.frames import Sensor
from valerie.cli.shell import DataDir, Exit, RunId, Url, show_error
from valerie.errors import InvalidInput, NotFound

predictions_app = typer.Typer(no_args_is_help=True, help="Upload label maps that were predicted elsewhere.")


@predictions_app.command("put")
def put(
    run_id: RunId,
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of label maps `FRAME.png` with 8-bit class ids.")
    ],
    function: Annotated[
        str | None,
        typer.Option("--function", metavar="NAME", help="Function of kind predictions; by default the run's only one."),
    ] = None,
    sensor: Sensor = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Upload predictions for frames of a run. Exits with 3 if any is refused."""
    from valerie.cli.connecting import client_at
    from valerie.client import ServerProblemError

    if not folder.is_dir():
        raise NotFound("folder", folder)
    paths = sorted(folder.glob("*.png"))
    foreign = [path.name for path in paths if not path.name.startswith(f"{run_id}.")]
    if foreign or not paths:
        names = ", ".join(foreign[:3]) or "no PNG"
        raise InvalidInput("files must be named after frames", field="DIR", value=names, limit=f"as {run_id}.0.0.0.png")
    new = existing = refused = 0
    with client_at(url, data_dir) as client:
        try:
            client.run(run_id)  # so that an unknown run gives one error, not one per file
        except ServerProblemError as error:
            if error.status != HTTPStatus.FORBIDDEN:  # a token with the scope predictions alone reads no runs
                raise
        for path in paths:
            try:
                if client.put_prediction(path.stem, path.read_bytes(), function=function, sensor=sensor):
                    new += 1
                else:
                    existing += 1
            except ServerProblemError as error:
                if not error.is_callers_fault:
                    raise
                refused += 1
                if refused <= 10:
                    show_error(f"{path.name}: {error}")
    typer.echo(f"{new:,} predictions uploaded, {existing:,} already there, {refused:,} refused")
    if refused:
        raise typer.Exit(Exit.COMPLETED_WITH_FAILURES)
