"""Commands for predictions that people bring: the frames of a run as files, and label maps back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from valerie.cli.shell import DataDir, Exit, Url, command_name, say, settings_of, show_error
from valerie.errors import InvalidInput, NotFound

frames_app = typer.Typer(no_args_is_help=True, help="The frames of a run as pictures.")
predictions_app = typer.Typer(no_args_is_help=True, help="Label maps that were predicted elsewhere.")

RunId = Annotated[str, typer.Argument(metavar="RUN", help="Id of a run.")]
Sensor = Annotated[
    str | None, typer.Option("--sensor", metavar="NAME", help="Sensor setting; the run's only one by default.")
]


@frames_app.command("export")
def export(
    run_id: RunId,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write into; made if need be.")],
    sensor: Sensor = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write what functions see of every rendered frame of a run: `FRAME.png`.

    Frames that are in the folder already are left alone, so that the same command
    fetches the rest later.
    """
    from valerie.cli.connecting import client_of

    with client_of(settings_of(data_dir), url) as client:
        written = there = waiting = 0
        folder.mkdir(parents=True, exist_ok=True)
        for frame in client.frames(run_id):
            path = folder / f"{frame['id']}.png"
            if path.exists():
                there += 1
            elif frame["state"] != "done":
                waiting += 1
            else:
                partial = path.with_suffix(".part")
                partial.write_bytes(client.picture(frame["id"], sensor=sensor))
                partial.replace(path)
                written += 1
    typer.echo(f"{folder}: {written:,} frames written, {there:,} were there, {waiting:,} are not rendered yet")
    if waiting:
        say("the same command fetches the rest when they are")
    say(f"bring label maps of the same names with: {command_name()} predictions put {run_id} LABELS")


@predictions_app.command("put")
def put(
    run_id: RunId,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Label maps `FRAME.png`: 8 bits, ids of the classes.")],
    function: Annotated[
        str | None, typer.Option("--function", metavar="NAME", help="The run's only one of this kind by default.")
    ] = None,
    sensor: Sensor = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Bring predictions for frames of a run; exits with 3 when some were refused."""
    from valerie.cli.connecting import client_of
    from valerie.client import ServerProblemError

    if not folder.is_dir():
        raise NotFound("folder", folder)
    paths = sorted(folder.glob("*.png"))
    foreign = [path.name for path in paths if not path.name.startswith(f"{run_id}.")]
    if foreign or not paths:
        shown = ", ".join(foreign[:3]) or "no PNG"
        raise InvalidInput("files are named after frames", field="DIR", value=shown, limit=f"{run_id}.0.0.0.png")
    new = there = refused = 0
    with client_of(settings_of(data_dir), url) as client:
        client.run(run_id)  # an unknown run is one message, not one per file
        for path in paths:
            try:
                if client.put_prediction(path.stem, path.read_bytes(), function=function, sensor=sensor):
                    new += 1
                else:
                    there += 1
            except ServerProblemError as error:
                if not error.is_callers_fault:
                    raise
                refused += 1
                if refused <= 10:
                    show_error(f"{path.name}: {error}")
    typer.echo(f"{new:,} predictions brought, {there:,} were there, {refused:,} refused")
    if refused:
        raise typer.Exit(Exit.COMPLETED_WITH_FAILURES)
