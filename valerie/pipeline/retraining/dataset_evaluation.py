"""Functions under test on a data set of real (or exported) pictures, with the metrics of a run.

Pixels are ignored as in cityscapesScripts: those whose label has no train id (unlabeled, ego vehicle, out of roi, static,
dynamic, ground …), and license plates, which Cityscapes counts to the car (id 255, −1 in eight bits, is ignored too). A
prediction of void on a labelled pixel is a miss.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable
from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.frame import LabelledFrame
from valerie.datasets.twins import LEAST_OVERLAP, Twin
from valerie.db import results
from valerie.db.archives import reading_run
from valerie.errors import InvalidInput
from valerie.labels import TRAIN_NAMES
from valerie.measures import TableRow
from valerie.metrics.aggregate import FrameMean, frame_mean
from valerie.metrics.collection import CollectionScores, collection_scores
from valerie.metrics.instances import InstanceCounts
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import frame_scores
from valerie.metrics.scoring import ScoredFrame, score_frame
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.perception.running.batches import predicted
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import pinned_card
from valerie.pipeline.base.progress import Pace
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.functions.references import display_name
from valerie.pipeline.reading.selection import as_called, function_index
from valerie.plain import JsonObject
from valerie.runs.products.pins import FunctionPin
from valerie.statistics.fidelity import Fidelity, instance_fidelity
from valerie.statistics.units import sampling_units
from valerie.storage import codecs

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT: Final = "valerie-dataset-evaluation/1"


@dataclass(frozen=True, slots=True, eq=False)
class FunctionResult:
    """One function on all frames.

    Attributes:
        name: name in results (`display_name`); it differs between two versions of one function.
        card, numeric_class: of the function.
        names: names of the frames, in order.
        matrices: (19, 20) matrix of each frame.
        scores: scores derived from them.
        persons: pixels of each person in the labels; empty if the labels do not distinguish instances.
        rows: rows of the long table, likewise; a frame without persons has one.
        seconds: wall time of reading, predicting and counting.
    """

    name: str
    card: FunctionCard
    numeric_class: str
    names: tuple[str, ...]
    matrices: tuple[ConfusionMatrix, ...]
    scores: CollectionScores
    persons: tuple[InstanceCounts, ...]
    rows: tuple[TableRow, ...]
    seconds: float

    @property
    def person_pacc(self) -> FrameMean:
        """Mean pACC of the persons, equally weighted; undefined if the labels do not distinguish instances."""
        return frame_mean(person.pacc for person in self.persons)


@dataclass(frozen=True, slots=True, eq=False)
class DatasetResult:
    """All functions on one split.

    Attributes:
        root, split: the data set.
        digest: SHA-256 over names, pictures and labels, hex.
        has_instances: True if the labels distinguish persons.
        functions: in the order of the references.
    """

    root: Path
    split: str
    digest: str
    has_instances: bool
    functions: tuple[FunctionResult, ...]

    def as_document(self) -> JsonObject:
        """Return the result as JSON values, with `CollectionScores.as_document` per function."""
        return {
            "format": FORMAT,
            "dataset": self.root.name,
            "split": self.split,
            "digest": self.digest,
            "has_instances": self.has_instances,
            "class_order": list(TRAIN_NAMES.values()),
            "functions": {
                function.name: {
                    "card": asdict(function.card),
                    "numeric_class": function.numeric_class,
                    "seconds": round(function.seconds, 3),
                    "person_pacc": asdict(function.person_pacc),
                    **function.scores.as_document(),
                }
                for function in self.functions
            },
        }

    def table(self) -> EvaluationTable:
        """Return the long table: one row per (frame, function, person); columns that labels cannot fill are empty."""
        return EvaluationTable.from_rows((row for function in self.functions for row in function.rows), {})

    def write(self, folder: Path) -> tuple[Path, ...]:
        """Write ``evaluation.json``, ``frames.parquet`` and, if the labels distinguish persons, ``persons.parquet``."""
        import pyarrow.parquet as pq

        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / "evaluation.json", folder / "frames.parquet"]
        files[0].write_text(json.dumps(self.as_document(), indent=1, ensure_ascii=False) + "\n")
        pq.write_table(_frame_table(self), files[1], compression="zstd")
        if self.has_instances:
            files.append(folder / "persons.parquet")
            self.table().to_parquet(files[-1])
        return tuple(files)


@dataclass(frozen=True, slots=True)
class TwinScores:
    """One function on the persons that two data sets show.

    Attributes:
        pacc_here, pacc_there: mean pACC of these persons.
        fidelity: agreement about which of them are missed; its sampling unit is the recording place.
    """

    pacc_here: float
    pacc_there: float
    fidelity: Fidelity

    def as_document(self) -> JsonObject:
        """Return JSON values."""
        own = self.fidelity
        return asdict(self) | {"persons": own.persons, "same_outcome": own.share, "kappa": own.kappa}


def compare_twins(
    here: DatasetResult, there: DatasetResult, twins: Sequence[Twin], *, threshold: float = 0.5
) -> dict[str, TwinScores]:
    """Compare each function on the same persons of two data sets, such as recorded frames and their rendered twins.

    Args:
        here, there: the same functions on both data sets.
        twins: the persons (`valerie.datasets.twins.person_twins`).
        threshold: smallest pACC of a detected person; the others are missed.

    Raises:
        InvalidInput: the data sets share no person.
    """
    if not twins:
        raise InvalidInput(
            "the data sets share no person",
            field="--twin",
            value=str(there.root),
            limit=f"boxes whose intersection over union is at least {LEAST_OVERLAP:g}",
        )
    _, frames = np.unique([str(frame) for frame, _, _ in twins], return_inverse=True)
    _, places = np.unique([frame.city for frame, _, _ in twins], return_inverse=True)
    units = sampling_units("grid", frames, sites=places)
    compared = {}
    for own, other in zip(here.functions, there.functions, strict=True):
        scores_here, scores_there = (
            {(row["frame_id"], row["instance_id"]): row["pacc"] for row in side.rows if "instance_id" in row}
            for side in (own, other)
        )
        pacc_here = np.array([scores_here[str(frame), number] for frame, number, _ in twins], np.float64)
        pacc_there = np.array([scores_there[str(frame), number] for frame, _, number in twins], np.float64)
        fidelity = instance_fidelity(pacc_here < threshold, pacc_there < threshold, units)
        compared[own.name] = TwinScores(float(pacc_here.mean()), float(pacc_there.mean()), fidelity)
    return compared


@dataclass(frozen=True, slots=True)
class _Truth:
    """A labelled frame for `score_frame`; the persons are the visible ones."""

    class_map: NDArray[np.uint8]
    instance_map: NDArray[np.uint16]
    persons: tuple[InstanceCounts, ...] = ()


def evaluate_dataset(
    folder: CityscapesFolder,
    references: Sequence[str],
    *,
    open_function: Callable[[str], PerceptionFunction],
    progress: Pace = lambda *_: None,
) -> DatasetResult:
    """Evaluate functions on one split, one function after the other.

    Args:
        folder: the split.
        references: references of the functions; at least one.
        open_function: opens a reference; the function is closed before the next is opened.
        progress: is told the frames so far, of all functions together, and the function that sees them.

    Raises:
        InvalidInput: no function, one named twice, or files that are no labels.
        CorruptArtifact: a damaged file.
        InferenceError: a function failed or returned another size.
    """
    names = [display_name(reference) for reference in references]
    if not references or len(set(names)) < len(names):
        raise InvalidInput("name each function once", field="--function", value=names)
    dataset = f"{folder.root.name}/{folder.split}"
    total, done, started = len(folder) * len(references), 0, time.monotonic()
    evaluated: list[FunctionResult] = []
    content = hashlib.sha256()
    for number, (name, reference) in enumerate(zip(names, references, strict=True)):
        matrices: list[ConfusionMatrix] = []
        persons: list[InstanceCounts] = []
        rows: list[TableRow] = []
        with closing(open_function(reference)) as function:
            began = time.monotonic()
            frames = ((frame, frame.picture) for frame in folder)
            for index, (frame, labels) in enumerate(predicted(function, frames)):
                if number == 0:
                    for part in (str(frame.name).encode(), frame.picture.tobytes(), frame.segment_ids.tobytes()):
                        content.update(part)
                truth = _Truth(frame.class_map, frame.instance_map)
                scored = score_frame(truth, labels, function.card.judged_ids)
                matrices.append(scored.matrix)
                if folder.has_instances:
                    persons += scored.persons
                    rows += _person_rows(scored, name, frame, index, dataset)
                done += 1
                progress(done, total, done / max(time.monotonic() - started, 1e-9), name)
            evaluated.append(
                FunctionResult(
                    name=name,
                    card=function.card,
                    numeric_class=function.numeric_class,
                    names=tuple(str(frame_name) for frame_name in folder.names),
                    matrices=tuple(matrices),
                    scores=collection_scores(matrices, function.card.judged_ids),
                    persons=tuple(persons),
                    rows=tuple(rows),
                    seconds=time.monotonic() - began,
                )
            )
    return DatasetResult(folder.root, folder.split, content.hexdigest(), folder.has_instances, tuple(evaluated))


def _person_rows(scored: ScoredFrame, name: str, frame: LabelledFrame, index: int, dataset: str) -> list[TableRow]:
    """Return the rows of the long table of the frame at an index of its split; ``dataset`` stands for a run's id."""
    common = {
        "run_id": dataset,
        "variant_index": index,
        "frame_id": str(frame.name),
        "camera": frame.name.city,
        "sensor": "as recorded",
        "function": name,
        **scored.scores.measures,
    }
    if not scored.persons:
        return [{**common, "tp": 0, "fn": 0, "undefined_reason": "absent"}]
    pixels = frame.class_map.size
    return [
        {
            **common,
            "instance_id": person.instance_id,
            "pixel_area": person.tp + person.fn,
            "pixel_area_percent": 100.0 * (person.tp + person.fn) / pixels,
            **person.measures,
        }
        for person in scored.persons
    ]


def _frame_table(result: DatasetResult) -> pa.Table:
    """Return one row per frame and function: names, counts of the class person, scores, flat confusion matrix."""
    import pyarrow as pa

    rows = []
    for function in result.functions:
        for name, matrix in zip(function.names, function.matrices, strict=True):
            scores = frame_scores(matrix, classes=function.scores.judged)
            rows.append(
                {
                    "frame": name,
                    "function": function.name,
                    **asdict(scores.counts),
                    "pacc": scores.pacc,
                    **scores.measures,
                    "confusion": matrix.ravel().tolist(),
                }
            )
    return pa.Table.from_pylist(rows)


@dataclass(frozen=True, slots=True, eq=False)
class RunSide:
    """One function in a run, for comparison with a data set.

    Attributes:
        called: its name in the run's spec.
        pin: digest and numeric class that the run pinned; `valerie.pipeline.functions.references.open_pinned` opens it again.
        scores: scores on the run's evaluated frames (first sensor setting).
    """

    called: str
    pin: FunctionPin
    scores: CollectionScores


def run_side(context: Context, run_id: str, function: str) -> RunSide:
    """Return a function's scores on a run's frames, and its version.

    Args:
        context: context of the deployment.
        run_id: id of the run.
        function: its name in the run's spec, or ``name@digest`` of the version in the run.

    Raises:
        NotFound, UnknownName: no such run, or a function that it did not evaluate.
        Conflict: the run has not started yet.
    """
    run = read_run(context, run_id)
    name = as_called(function, run)
    with reading_run(context.engine, run_id) as connection:
        predictions = results.predictions(connection, run_id, 0, function_index(name, run.resolved))
    judged = pinned_card(run.pins, name).judged_ids
    scores = collection_scores(
        [codecs.decode_counts(prediction.confusion) for prediction in predictions.values()], judged
    )
    return RunSide(name, run.pins.functions[name], scores)
