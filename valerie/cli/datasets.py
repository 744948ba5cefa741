"""Commands about data sets in files: exporting a run's frames."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from valerie.cli.deployment import context_of
from valerie.cli.frames import Annotations, annotation_names
from valerie.cli.shell import DataDir, Json, say
from valerie.errors import InvalidInput, UnknownName

if TYPE_CHECKING:
    from valerie.pipeline.export.datasets import ExportProgress

app = typer.Typer(no_args_is_help=True, help="Export runs as data sets.")

_LINE_SECONDS: Final = 5.0

Where = Annotated[
    str,
    typer.Option(
        "--where", metavar="EXPRESSION", help='Only frames with a person that meets it: "occlusion_rate < 0.5".'
    ),
]


@app.command()
def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id of a run.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to make.")],
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", metavar="cityscapes|coco|parquet", help="May be repeated; all by default."),
    ] = None,
    where: Where = "",
    splits: Annotated[
        str, typer.Option("--split", metavar="SPLITS", help="One split, or shares: train=0.8,val=0.2.")
    ] = "val",
    sensor: Annotated[
        str | None, typer.Option("--sensor", metavar="NAME", help="Sensor setting; the run's first by default.")
    ] = None,
    predictions: Annotated[
        list[str] | None,
        typer.Option("--predictions", metavar="FUNCTION", help="Also what a function made of the frames."),
    ] = None,
    annotations: Annotations = None,
    polygons: Annotated[bool, typer.Option("--polygons", help="Also Cityscapes' polygons (larger, slower).")] = False,
    as_json: Json = False,
    data_dir: DataDir = None,
) -> None:
    """Write a run's frames with their labels in Cityscapes layout, as COCO, and as a Parquet index.

    The folder appears when it is complete; an interrupted export goes on when it is asked for again.
    """
    from valerie.pipeline.export.datasets import export_run
    from valerie.pipeline.export.plan import FORMATS, ExportSettings

    for name in formats or ():
        if name not in FORMATS:
            raise UnknownName("format", name, FORMATS, field="--format")
    settings = ExportSettings(
        formats=tuple(name for name in FORMATS if name in (formats or FORMATS)),
        where=where,
        splits=parse_splits(splits),
        sensor=sensor,
        predictions=tuple(predictions or ()),
        annotations=annotation_names(annotations),
        polygons=polygons,
    )
    lines = Lines("frames")

    def tell(now: ExportProgress) -> None:
        lines.tell(now.done, now.total, now.frames_per_s, f"{now.resumed:,} were there" if now.resumed else "")

    with context_of(data_dir) as context:
        made = export_run(context, run, out, settings, progress=tell)
    if as_json:
        document = {"folder": str(made.folder), "frames": dict(made.frames), "left_out": made.left_out}
        typer.echo(json.dumps(document))
        return
    split_text = ", ".join(f"{count:,} {split}" for split, count in made.frames.items())
    rest = f"; {made.left_out:,} finished frames do not meet the expression" if made.left_out else ""
    typer.echo(f"{made.folder}: {split_text}{rest}")


def parse_splits(text: str) -> dict[str, float]:
    """``val`` or ``train=0.8,val=0.2`` as split to share.

    Raises:
        InvalidInput: not of that form.
    """
    if "=" not in text:
        return {text: 1.0}
    shares: dict[str, float] = {}
    for part in text.split(","):
        name, _, share = part.partition("=")
        try:
            shares[name.strip()] = float(share)
        except ValueError:
            raise InvalidInput("not a share", field="--split", value=part, limit="train=0.8,val=0.2") from None
    return shares


class Lines:
    """Progress as one line now and then: how many, how fast, how long."""

    def __init__(self, what: str) -> None:
        self._what, self._shown_at = what, time.monotonic()

    def tell(self, done: int, total: int, per_s: float, note: str = "") -> None:
        """Print a line if some seconds went by, or all is done."""
        if time.monotonic() - self._shown_at < _LINE_SECONDS and done < total:
            return
        self._shown_at = time.monotonic()
        from valerie.cli.display import duration

        text = f"{done:,} of {total:,} {self._what}" + (f" ({note})" if note else "")
        if per_s:
            text += f", {per_s:.1f}/s" if per_s >= 1 else f", {1 / per_s:.1f} s each"
            if done < total:
                text += f", {duration((total - done) / per_s)} left"
        say(text)
