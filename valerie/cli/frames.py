"""The command that exports the frames of a run as files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.shell import DataDir, RunId, Url, say
from valerie.local.terminal import command_name

if TYPE_CHECKING:
    from valerie.client import Client
    from valerie.local.folder import Folder

frames_app = typer.Typer(no_args_is_help=True, help="Export the frames of a run as pictures.")

Sensor = Annotated[
    str | None, typer.Option("--sensor", metavar="NAME", help="Sensor setting; by default the run's only one.")
]
Annotations = Annotated[
    str | None,
    typer.Option(
        "--annotations",
        metavar="KINDS",
        help="Annotations to include: a,b or none; by default all of the run.",
    ),
]


@frames_app.command("export")
def export(
    run_id: RunId,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write to; created if it does not exist.")],
    sensor: Sensor = None,
    annotations: Annotations = None,
    url: Url = None,
    data_dir: DataDir = None,
) -> None:
    """Write the picture of every rendered frame of a run as `FRAME.png`, and its annotations as `FRAME_KIND.npz`.

    Existing files are kept, so the same command can fetch the remaining ones
    later. Needs no server.
    """
    from valerie.cli.connecting import source_of
    from valerie.client import ServerProblemError
    from valerie.errors import Conflict
    from valerie.pipeline.base.deadlines import AWAITING
    from valerie.runs.products.states import ProductState

    with source_of(data_dir, url) as source:
        run = source.run(run_id)
        kinds = annotation_names(annotations)
        if kinds is None:
            kinds = source.annotations(run_id)
        written, existing, missing, removed = 0, 0, Counter[str](), Counter[str]()
        folder.mkdir(parents=True, exist_ok=True)
        for frame in source.frames(run_id):
            if frame.state != ProductState.DONE:
                if frame.removed is not None:
                    removed[f"removed ({frame.removed})"] += 1
                else:
                    missing["failed" if frame.state == ProductState.FAILED else "not rendered yet"] += 1
                continue
            try:
                new = _fetch(source, frame.id, folder, sensor, kinds)
            except (Conflict, ServerProblemError) as error:
                if isinstance(error, ServerProblemError) and error.status != HTTPStatus.CONFLICT:
                    raise
                missing[f"without all annotations ({error})"] += 1
                continue
            written, existing = written + new, existing + (not new)
    rest = [f"{count:,} {reason}" for reason, count in (missing + removed).items()]
    frames = "frame" if written == 1 else "frames"
    typer.echo(f"{folder}: {', '.join([f'{written:,} {frames} written', f'{existing:,} already there', *rest])}")
    if missing:
        say("run the same command later to fetch the rest")
    if run.reason is not None and run.reason.startswith(AWAITING):
        say(f"upload label maps of the same names with: {command_name()} predictions put {run_id} LABELS")


def annotation_names(text: str | None) -> tuple[str, ...] | None:
    """Return the names in ``a,b``; an empty tuple for ``none``; None for None."""
    if text is None:
        return None
    return () if text == "none" else tuple(name.strip() for name in text.split(",") if name.strip())


def _fetch(source: Client | Folder, frame: str, folder: Path, sensor: str | None, kinds: tuple[str, ...]) -> bool:
    """Write the missing files of a frame; return True if there were any."""
    files: dict[str, Callable[[], bytes]] = {f"{frame}.png": partial(source.picture, frame, sensor=sensor)}
    files |= {f"{frame}_{kind}.npz": partial(source.annotation, frame, kind) for kind in kinds}
    missing = {folder / name: read for name, read in files.items() if not (folder / name).exists()}
    for path, read in missing.items():
        unfinished = path.with_suffix(".part")
        unfinished.write_bytes(read())
        unfinished.replace(path)
    return bool(missing)
