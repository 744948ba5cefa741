"""`valerie evaluate`: functions under test on an annotated data set of real pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.shell import DataDir, InferenceThreads, Json, console, say, settings_of
from valerie.errors import InvalidInput, NotFound

if TYPE_CHECKING:
    from rich.console import RenderableType

    from valerie.metrics.collection import Averages, CollectionScores
    from valerie.perception.base import PerceptionFunction
    from valerie.pipeline.retraining.dataset_evaluation import DatasetResult


def evaluate(
    dataset: Annotated[
        Path, typer.Option("--dataset", metavar="DIR", help="Folder with leftImg8bit and gtFine, as Cityscapes has it.")
    ],
    functions: Annotated[
        list[str],
        typer.Option("--function", metavar="NAME", help="A function, or a function file; may be repeated."),
    ],
    split: Annotated[
        str | None, typer.Option("--split", metavar="NAME", help="Which split; the only one, or val, by default.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Also write evaluation.json and Parquet tables there.")
    ] = None,
    beside: Annotated[
        str | None, typer.Option("--beside", metavar="RUN", help="Show a run's scores of the versions that it saw too.")
    ] = None,
    threads: InferenceThreads = None,
    as_json: Json = False,
    data_dir: DataDir = None,
) -> None:
    """Evaluate functions on a data set in Cityscapes layout, with the metrics of runs.

    Ignores what cityscapesScripts ignores. Every score stands there as frame mean and pooled. Beside a run a
    function is the version that the run saw, run as it was there.
    """
    from valerie.cli.datasets import Lines
    from valerie.cli.deployment import deployment_or_empty
    from valerie.datasets.cityscapes import CityscapesFolder
    from valerie.pipeline.functions.references import open_pinned, open_reference
    from valerie.pipeline.retraining.dataset_evaluation import evaluate_dataset, run_side

    folder = CityscapesFolder(dataset, split or _split(dataset))
    lines = Lines("frames")
    with deployment_or_empty(settings_of(data_dir)) as deployment:
        seen = {} if beside is None else {name: run_side(deployment, beside, name) for name in functions}

        def opened(name: str) -> PerceptionFunction:
            if name in seen:
                return open_pinned(seen[name].called, seen[name].pin, context=deployment, threads=threads)
            return open_reference(name, context=deployment, threads=threads)

        for name in seen:  # before hours of work: they may be gone, or run otherwise here
            opened(name).close()
        result = evaluate_dataset(
            folder,
            functions,
            open_function=opened,
            progress=lambda now: lines.tell(now.done, now.total, now.frames_per_s, now.function),
        )
    also = {name: side.scores for name, side in seen.items()}
    if out is not None:
        for path in result.write(out):
            say(f"wrote {path}")
    if as_json:
        document = result.as_document()
        if beside is not None:
            document["beside"] = {"run": beside} | {name: one.as_document() for name, one in also.items()}
        typer.echo(json.dumps(document, ensure_ascii=False))
        return
    shown = console()
    for part in _parts(result, beside, also):
        shown.print(part)


def _split(dataset: Path) -> str:
    from valerie.datasets.cityscapes import CityscapesFolder

    splits = CityscapesFolder.splits(dataset)
    if not splits:
        raise NotFound("folder leftImg8bit with splits in", dataset)
    if len(splits) > 1 and "val" not in splits:
        raise InvalidInput("the data set has several splits", field="--split", limit=", ".join(splits))
    return splits[0] if len(splits) == 1 else "val"


def _parts(result: DatasetResult, beside: str | None, also: dict[str, CollectionScores]) -> list[RenderableType]:
    from rich.table import Table
    from rich.text import Text

    from valerie.analysis.wording import classes_text
    from valerie.labels import TRAIN_LABELS

    here = f"{result.root.name}/{result.split}"
    columns = [(f"{one.name}\n{here}", one.scores) for one in result.functions]
    columns += [(f"{name}\nrun {beside}", scores) for name, scores in also.items()]

    persons = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    for name in ("person", "frames", "pACC mean", "min", "max", "pACC pooled"):
        persons.add_column(name, justify="left" if name == "person" else "right")
    for name in ("precision mean", "pooled", "IoU mean", "pooled", "mIoU mean", "pooled", "as Cityscapes"):
        persons.add_column(name, justify="right")
    for title, scores in columns:
        one, all_classes = scores.of(), scores.overall
        frames = one.pacc.frames
        persons.add_row(
            title.replace("\n", ", "),
            f"{frames.defined} of {scores.frames}",
            *(_percent(value) for value in (frames.mean, frames.minimum, frames.maximum, one.pacc.pooled)),
            *_both(one.precision),
            *_both(one.iou),
            *_both(all_classes["miou"]),
            _percent(all_classes["miou_cityscapes"].pooled),
        )

    classes = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    classes.add_column("pooled over frames\nIoU / recall", no_wrap=True)
    for title, _ in columns:
        classes.add_column(title, justify="right")
    for label in TRAIN_LABELS:
        judged = {title: scores.of(label) for title, scores in columns if label.train_id in scores.judged}
        if any(one.counts.tp + one.counts.fn + one.counts.fp for one in judged.values()):
            cells = [judged.get(title) for title, _ in columns]
            classes.add_row(
                label.name,
                *("–" if c is None else f"{_percent(c.iou.pooled)} / {_percent(c.pacc.pooled)}" for c in cells),
            )
    people = [
        f"{one.name}: {one.person_pacc.defined:,} persons, mean pACC {_percent(one.person_pacc.mean)}"
        for one in result.functions
        if one.person_pacc.defined
    ]
    notes = [
        "In per cent. Mean, min and max are over the frames that show a person; pooled sums the pixels of all frames."
    ]
    ran = {one.name: one.numeric_class for one in result.functions}
    if len(set(ran.values())) == 1:
        notes.append(f"Run as {next(iter(ran.values()))}.")
    else:
        notes.append(f"Run as {'; '.join(f'{name}: {one}' for name, one in ran.items())}: numeric classes differ.")
    partial = {one.name: one.card.judged_by for one in result.functions if one.card.judged_by}
    notes += [f"{name} is judged by {classes_text(by)}: that is what its mIoU is over." for name, by in partial.items()]
    if people:
        notes.append("Each person weighing the same: " + "; ".join(people) + ".")
    return [persons, "", classes, "", *(Text(note, style="dim") for note in notes)]


def _both(score: Averages) -> tuple[str, str]:
    return _percent(score.frames.mean), _percent(score.pooled)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"
