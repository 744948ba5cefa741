"""The command that exports a run as a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.frames import Annotations, annotation_names
from valerie.cli.option_documents import takes_documents
from valerie.cli.progress_lines import ProgressLines
from valerie.cli.shell import AsJson, DataDir, print_json
from valerie.errors import InvalidInput, UnknownName
from valerie.local.deployment import context_of

if TYPE_CHECKING:
    from valerie.pipeline.export.export_plan import ExportSettings

app = typer.Typer(no_args_is_help=True, help="Export runs as data sets.")

Where = Annotated[
    str,
    typer.Option(
        "--where",
        metavar="EXPRESSION",
        help='Only frames with a person that satisfies this expression: "occlusion_rate < 0.5".',
    ),
]


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Parts of a run that a data set has."""

    formats: Annotated[
        list[str] | None,
        typer.Option("--format", metavar="cityscapes|coco|openlabel|parquet", help="Can be repeated; by default all."),
    ] = None
    where: Where = ""
    splits: Annotated[
        str, typer.Option("--split", metavar="SPLITS", help="One split, or shares: train=0.8,val=0.2.")
    ] = "val"
    sensor: Annotated[
        str | None, typer.Option("--sensor", metavar="NAME", help="Sensor setting; by default the run's first.")
    ] = None
    predictions: Annotated[
        list[str] | None,
        typer.Option(
            "--predictions", metavar="FUNCTION", help="Include the predictions of a function; can be repeated."
        ),
    ] = None
    annotations: Annotations = None
    polygons: Annotated[bool, typer.Option("--polygons", help="Include Cityscapes polygons (larger and slower).")] = (
        False
    )

    def settings(self) -> ExportSettings:
        """Return them as settings.

        Raises:
            UnknownName, InvalidInput: a format, a split or an annotation is not known.
        """
        from valerie.pipeline.export.export_plan import FORMATS, ExportSettings

        for name in self.formats or ():
            if name not in FORMATS:
                raise UnknownName("format", name, FORMATS, field="--format")
        return ExportSettings(
            formats=tuple(name for name in FORMATS if name in (self.formats or FORMATS)),
            where=self.where,
            splits=parse_splits(self.splits),
            sensor=self.sensor,
            predictions=tuple(self.predictions or ()),
            annotations=annotation_names(self.annotations),
            polygons=self.polygons,
        )


@app.command()
@takes_documents
def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Id of a run.")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to create.")],
    options: ExportOptions,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Write the frames of a run with their labels in Cityscapes layout, as COCO and OpenLABEL, and as a Parquet index.

    The folder appears when it is complete. Run the same command again to continue an interrupted export.
    """
    from valerie.pipeline.export.datasets import export_run

    settings = options.settings()
    with context_of(data_dir) as context:
        dataset = export_run(context, run, out, settings, progress=ProgressLines("frames").tell)
    if as_json:
        print_json(
            {
                "folder": str(dataset.folder),
                "frames": dict(dataset.frames),
                "left_out": dataset.left_out,
                "polygons_lose_percent": dict(dataset.polygons_lose_percent),
            }
        )
        return
    split_text = ", ".join(f"{count:,} {split}" for split, count in dataset.frames.items())
    rest = f"; {dataset.left_out:,} finished frames do not meet the expression" if dataset.left_out else ""
    typer.echo(f"{dataset.folder}: {split_text}{rest}")
    if dataset.polygons_lose_percent:
        losses = ", ".join(f"{share:g} % of {name}" for name, share in dataset.polygons_lose_percent.items())
        typer.echo(f"The polygons lose {losses}; the label pictures are exact.")


def parse_splits(text: str) -> dict[str, float]:
    """Return split to share for ``val`` or ``train=0.8,val=0.2``.

    Raises:
        InvalidInput: the text has neither form.
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
