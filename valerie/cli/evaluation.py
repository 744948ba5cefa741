"""`valerie evaluate`: evaluate functions under test on an annotated data set of real pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from valerie.cli.option_documents import takes_documents
from valerie.cli.shell import AsJson, DataDir, InferenceThreads, print_json, say
from valerie.errors import InvalidInput, NotFound
from valerie.local.deployment import settings_of
from valerie.local.terminal import console

if TYPE_CHECKING:
    from rich.console import RenderableType

    from valerie.datasets.cityscapes import CityscapesFolder
    from valerie.metrics.collection import Averages, CollectionScores
    from valerie.perception.base import PerceptionFunction
    from valerie.pipeline.retraining.dataset_evaluation import DatasetResult, TwinScores


@dataclass(frozen=True, slots=True)
class DatasetOptions:
    """A data set, and the one to compare it with."""

    dataset: Annotated[
        Path, typer.Option("--dataset", metavar="DIR", help="Folder in Cityscapes layout (leftImg8bit, gtFine).")
    ]
    split: Annotated[
        str | None, typer.Option("--split", metavar="NAME", help="Split to evaluate; by default the only one, or val.")
    ] = None
    twin: Annotated[
        Path | None,
        typer.Option(
            "--twin",
            metavar="DIR",
            help="Compare with a second data set that shows the same scenes in frames of equal names.",
        ),
    ] = None

    def open(self) -> tuple[CityscapesFolder, CityscapesFolder | None]:
        """Open the data set and its twin.

        Raises:
            NotFound, InvalidInput: a folder is no data set, or has several splits.
        """
        from valerie.datasets.cityscapes import CityscapesFolder

        folder = CityscapesFolder(self.dataset, self.split or _split(self.dataset))
        return folder, None if self.twin is None else CityscapesFolder(self.twin, _split(self.twin, self.split))


@takes_documents
def evaluate(
    data: DatasetOptions,
    functions: Annotated[
        list[str],
        typer.Option("--function", metavar="NAME", help="A function, or a function file; can be repeated."),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Also write evaluation.json and Parquet tables here.")
    ] = None,
    beside: Annotated[
        str | None,
        typer.Option("--beside", metavar="RUN", help="Compare with a run's scores of the same function versions."),
    ] = None,
    threads: InferenceThreads = None,
    as_json: AsJson = False,
    data_dir: DataDir = None,
) -> None:
    """Evaluate functions on a data set in Cityscapes layout, with the metrics of runs.

    Ignores the same pixels as cityscapesScripts. Shows every score as frame mean and pooled. With --beside, each
    function is the version that the run evaluated, with the same numeric class. With --twin, shows on how many persons
    both data sets agree, such as recorded frames and their rendered twins.
    """
    from valerie.cli.progress_lines import ProgressLines
    from valerie.datasets.twins import person_twins
    from valerie.local.deployment import deployment_or_empty
    from valerie.pipeline.functions.references import open_pinned, open_reference
    from valerie.pipeline.retraining.dataset_evaluation import compare_twins, evaluate_dataset, run_side

    folder, other = data.open()
    # Before hours of work.
    persons = [] if other is None else person_twins(folder, other)
    lines = ProgressLines("frames")
    with deployment_or_empty(settings_of(data_dir)) as deployment:
        sides = {} if beside is None else {name: run_side(deployment, beside, name) for name in functions}

        def open_function(name: str) -> PerceptionFunction:
            if name in sides:
                return open_pinned(sides[name].called, sides[name].pin, context=deployment, threads=threads)
            return open_reference(name, context=deployment, threads=threads)

        for name in sides:  # fails before hours of work if one is missing or has another numeric class here
            open_function(name).close()

        def evaluated(frames: CityscapesFolder) -> DatasetResult:
            return evaluate_dataset(
                frames,
                functions,
                open_function=open_function,
                progress=lines.tell,
            )

        result = evaluated(folder)
        twins = {} if other is None else compare_twins(result, evaluated(other), persons)
    run_scores = {name: side.scores for name, side in sides.items()}
    if out is not None:
        for path in result.write(out):
            say(f"wrote {path}")
    if as_json:
        document = result.as_document()
        if beside is not None:
            document["beside"] = {"run": beside} | {name: scores.as_document() for name, scores in run_scores.items()}
        if other is not None:
            document["twin"] = {"dataset": other.root.name, "split": other.split} | {
                name: scores.as_document() for name, scores in twins.items()
            }
        print_json(document)
        return
    output = console()
    for part in [*renderables(result, beside, run_scores), *_twin_lines(twins)]:
        output.print(part)


def _split(dataset: Path, preferred: str | None = None) -> str:
    from valerie.datasets.cityscapes import CityscapesFolder

    splits = CityscapesFolder.splits(dataset)
    if preferred in splits:
        return preferred
    if not splits:
        raise NotFound("folder leftImg8bit with splits in", dataset)
    if len(splits) > 1 and "val" not in splits:
        raise InvalidInput("the data set has several splits", field="--split", limit=", ".join(splits))
    return splits[0] if len(splits) == 1 else "val"


def renderables(
    result: DatasetResult, beside: str | None, run_scores: dict[str, CollectionScores]
) -> list[RenderableType]:
    """Return the tables and the notes of an evaluation.

    Args:
        result: the evaluation.
        beside: id of the run to compare with, or None.
        run_scores: function to its scores in that run.
    """
    return [*_tables(result, beside, run_scores), *_notes(result)]


def _tables(result: DatasetResult, beside: str | None, run_scores: dict[str, CollectionScores]) -> list[RenderableType]:
    from rich.table import Table

    from valerie.labels import TRAIN_LABELS

    dataset = f"{result.root.name}/{result.split}"
    columns = [(f"{function.name}\n{dataset}", function.scores) for function in result.functions]
    columns += [(f"{name}\nrun {beside}", scores) for name, scores in run_scores.items()]

    persons = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    for name in ("person", "frames", "pACC mean", "min", "max", "pACC pooled"):
        persons.add_column(name, justify="left" if name == "person" else "right")
    for name in ("precision mean", "pooled", "IoU mean", "pooled", "mIoU mean", "pooled", "as Cityscapes"):
        persons.add_column(name, justify="right")
    for title, scores in columns:
        person, all_classes = scores.of(), scores.overall
        frames = person.pacc.frames
        persons.add_row(
            title.replace("\n", ", "),
            f"{frames.defined} of {scores.frames}",
            *(_percent(value) for value in (frames.mean, frames.minimum, frames.maximum, person.pacc.pooled)),
            *_both(person.precision),
            *_both(person.iou),
            *_both(all_classes.miou),
            _percent(all_classes.miou_cityscapes.pooled),
        )

    classes = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    classes.add_column("pooled over frames\nIoU / recall", no_wrap=True)
    for title, _ in columns:
        classes.add_column(title, justify="right")
    for label in TRAIN_LABELS:
        judged = {title: scores.of(label) for title, scores in columns if label.train_id in scores.judged}
        if any(score.counts.tp + score.counts.fn + score.counts.fp for score in judged.values()):
            cells = [judged.get(title) for title, _ in columns]
            classes.add_row(
                label.name,
                *("–" if c is None else f"{_percent(c.iou.pooled)} / {_percent(c.pacc.pooled)}" for c in cells),
            )
    return [persons, "", classes, ""]


def _notes(result: DatasetResult) -> list[RenderableType]:
    from rich.text import Text

    from valerie.analysis.wording import classes_text

    notes = [
        "In per cent. Mean, min and max are over the frames that show a person; pooled sums the pixels of all frames."
    ]
    numeric_classes = {function.name: function.numeric_class for function in result.functions}
    if len(set(numeric_classes.values())) == 1:
        notes.append(f"Run as {next(iter(numeric_classes.values()))}.")
    else:
        by_function = "; ".join(f"{name}: {numeric_class}" for name, numeric_class in numeric_classes.items())
        notes.append(f"Run as {by_function}: numeric classes differ.")
    notes += [
        f"{function.name} is judged by {classes_text(function.card.judged_by)}; its mIoU covers only these."
        for function in result.functions
        if function.card.judged_by
    ]
    persons = [
        f"{function.name}: {function.person_pacc.defined:,} persons, mean pACC {_percent(function.person_pacc.mean)}"
        for function in result.functions
        if function.person_pacc.defined
    ]
    if persons:
        notes.append("Each person weighted equally: " + "; ".join(persons) + ".")
    return [Text(note, style="dim") for note in notes]


def _twin_lines(twins: Mapping[str, TwinScores]) -> list[RenderableType]:
    """Return the comparison of each function with the twin."""
    from rich.text import Text

    from valerie.analysis.comparison.wording import fidelity_sentence

    return [
        Text(
            f"{name} on the persons of both: mean pACC {_percent(scores.pacc_here)}, in the twin "
            f"{_percent(scores.pacc_there)}. {fidelity_sentence(scores.fidelity, 'here', 'in the twin')}"
        )
        for name, scores in twins.items()
    ]


def _both(score: Averages) -> tuple[str, str]:
    return _percent(score.frames.mean), _percent(score.pooled)


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"
