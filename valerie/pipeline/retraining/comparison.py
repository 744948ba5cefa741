"""Comparison of versions of a function on the stored frames of one run; nothing is rendered."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.comparison.before_after import VersionComparison, compare
from valerie.analysis.findings.region import Region
from valerie.analysis.rows.pairing import RowKey, aligned, row_keys
from valerie.analysis.rows.table import EvaluationTable
from valerie.db import results
from valerie.db.archives import reading_run
from valerie.errors import Conflict, InvalidInput
from valerie.measures import MEASURES, TableRow
from valerie.metrics.collection import collection_scores
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scoring import score_frame
from valerie.perception.base import PerceptionFunction
from valerie.perception.running.batches import predicted
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import pinned_card
from valerie.pipeline.base.progress import Pace
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.functions.references import display_name
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.selection import (
    ChosenFrame,
    evaluated_persons,
    finished_frames,
    function_index,
    run_where,
)
from valerie.pipeline.reading.tables import designs_of, varied_types
from valerie.pipeline.retraining.weak_scenes import run_values
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pins import inference_part, numeric_classes
from valerie.storage import codecs


@dataclass(frozen=True, slots=True, eq=False)
class _Evaluated:
    """One version on the run's frames (first sensor setting).

    Attributes:
        table: the long table of only this function.
        matrices: (19, 20) matrix of each frame.
    """

    table: EvaluationTable
    matrices: dict[FrameKey, ConfusionMatrix]


@dataclass(frozen=True, slots=True)
class _Version:
    """A version before it sees any frame.

    Attributes:
        reference: the user's reference.
        stored: True if the run evaluated it.
        numeric_class: numeric class that the run pinned, or in which it runs here.
        judged: train ids of the classes that it is judged by.
    """

    reference: str
    stored: bool
    numeric_class: str
    judged: frozenset[int]


@dataclass(frozen=True, slots=True)
class Grouping:
    """Groups of persons on which versions are compared, besides all persons.

    Attributes:
        where: expression that divides persons into two groups, *by the first function's scores*.
        region: region that divides persons into two groups. Unlike a selection by scores, it favours no later version by
            regression to the mean.
    """

    where: str = ""
    region: Region | None = None


def compare_on_run(
    context: Context,
    run_id: str,
    references: Sequence[str],
    *,
    open_function: Callable[[str], PerceptionFunction],
    grouping: Grouping = Grouping(),
    mixed: bool = False,
    progress: Pace = lambda *_: None,
) -> VersionComparison:
    """Compare functions on a run's frames; the first is "before".

    Scores over all classes cover those that every version is judged by.

    Args:
        context: context of the deployment.
        run_id: id of the validation run.
        references: names or function files; those that the run evaluated are read, the others predict all frames now.
        open_function: opens a reference.
        grouping: groups of persons.
        mixed: also compare versions in different numeric classes, to see the effect of precision or engine.
        progress: is told the frames that a function has seen, and its name.

    Raises:
        NotFound, InvalidInput, UnknownName: no such run, function or column.
        Conflict: the run has no finished frames, or versions run in different numeric classes without ``mixed``.
        InferenceError: a function failed.
    """
    if len(references) < 2 or len({display_name(reference) for reference in references}) < len(references):
        raise InvalidInput("name two or more different functions", field="versions", value=list(references))
    run = read_run(context, run_id)
    with reading_run(context.engine, run_id) as connection:
        frames = list(finished_frames(connection, run))
    if not frames:
        raise Conflict(f"run {run_id} has no finished frames yet")
    versions = {display_name(reference): _version(reference, run, open_function) for reference in references}
    if not mixed:  # before any function sees a frame
        _require_one_class(versions)
    evaluated = {
        name: _stored(context, run, version.reference)
        if version.stored
        else _evaluate(context, run, frames, version.reference, open_function, progress)
        for name, version in versions.items()
    }
    tables = aligned([version.table for version in evaluated.values()])
    keys = sorted(set.intersection(*(set(version.matrices) for version in evaluated.values())))
    common = sorted(frozenset.intersection(*(version.judged for version in versions.values())))
    compared = {
        name: (table, collection_scores([version.matrices[key] for key in keys], common))
        for (name, version), table in zip(evaluated.items(), tables, strict=True)
    }
    groups = _groups(context, run, tables[0], next(iter(evaluated)), grouping)
    return compare(
        compared,
        numeric_classes=[version.numeric_class for version in versions.values()],
        more_groups=groups,
        threshold=run.resolved.spec.detection_threshold,
    )


def _version(reference: str, run: StoredRun, open_function: Callable[[str], PerceptionFunction]) -> _Version:
    if reference in run.resolved.spec.functions:
        card, numeric_class = pinned_card(run.pins, reference), numeric_classes(run.pins)[inference_part(reference)]
        return _Version(reference, True, numeric_class, frozenset(card.judged_ids))
    with closing(open_function(reference)) as function:
        return _Version(reference, False, function.numeric_class, frozenset(function.card.judged_ids))


def _require_one_class(versions: Mapping[str, _Version]) -> None:
    if len({version.numeric_class for version in versions.values()}) > 1:
        classes = "; ".join(
            f"{name} {'ran' if version.stored else 'runs here'} as {version.numeric_class}"
            for name, version in versions.items()
        )
        raise Conflict(
            f"versions in different numeric classes are not compared: {classes}. Name all of them in the spec of one run "
            "(equal frames are not rendered again), compare where the run's workers run and with as many threads, or use "
            "--mixed to see the effect of precision or engine"
        )


def _groups(
    context: Context,
    run: StoredRun,
    table: EvaluationTable,
    before: str,
    grouping: Grouping,
) -> dict[str, NDArray[np.bool_]]:
    """Return the selected rows and the rows in the region, each with its complement."""
    groups: dict[str, NDArray[np.bool_]] = {}
    where, region = grouping.where, grouping.region
    if not where and region is None:
        return groups
    with reading_run(context.engine, run.id) as connection:
        persons = evaluated_persons(connection, run)
        assigned: dict[RowKey, TableRow] = {
            (str(person.frame), person.instance_id or None): person.row for person in persons
        }
    # The first version's scores replace the stored ones.
    rows = [{**assigned.get(key, {}), **row} for key, row in zip(row_keys(table), table.arrow.to_pylist(), strict=True)]
    present = np.array([row["instance_id"] is not None for row in rows], np.bool_)
    if region is not None:
        inside = np.array(
            [
                bool(row["instance_id"]) and region.holds(run_values(row["instance_id"], row, run.resolved))
                for row in rows
            ],
            np.bool_,
        )
        groups["in the region"], groups["outside the region"] = inside, present & ~inside
    if where:
        condition = run_where(where, run.resolved)
        mask = np.array([condition.holds(row) for row in rows], np.bool_)
        groups[f"selected by the scores of {before}"], groups["not selected"] = mask & present, present & ~mask
    return groups


def _stored(context: Context, run: StoredRun, function: str) -> _Evaluated:
    index = function_index(function, run.resolved)
    varied = varied_types(run.resolved)
    with reading_run(context.engine, run.id) as connection:
        rows = [person.row for person in evaluated_persons(connection, run, sensor=0, function=index)]
        predictions = results.predictions(connection, run.id, 0, index)
    table = EvaluationTable.from_rows(
        ({name: row.get(name) for name in _columns(varied)} for row in rows), varied, designs_of(run)
    )
    return _Evaluated(table, {key: codecs.decode_counts(stored.confusion) for key, stored in predictions.items()})


def _evaluate(
    context: Context,
    run: StoredRun,
    frames: Sequence[ChosenFrame],
    reference: str,
    open_function: Callable[[str], PerceptionFunction],
    progress: Pace,
) -> _Evaluated:
    """Predict and score every frame in this process, like the evaluation stage."""
    varied, name = varied_types(run.resolved), display_name(reference)
    reader = ProductReader(context.store)
    rows: list[TableRow] = []
    matrices: dict[FrameKey, ConfusionMatrix] = {}
    started = time.monotonic()
    with closing(open_function(reference)) as function:
        shots = ((frame, capture_of(run.resolved, frame.stored, 0)) for frame in frames)
        pictures = ((shot, shot[1].picture(reader)) for shot in shots)
        for done, ((frame, capture), labels) in enumerate(predicted(function, pictures), start=1):
            truth = capture.seen_truth(reader)
            scored = score_frame(truth, labels, function.card.judged_ids)
            matrices[frame.key], scores = scored.matrix, scored.scores
            for person in frame.persons:
                view = measured_again(person, truth) if capture.distorted else person
                counts = scored.person(person.instance_id)
                row = {
                    **frame.row(view, run.resolved),
                    **{path: frame.stored.assignment.get(path) for path in varied},
                    "function": name,
                    **counts.measures,
                    **scores.measures,
                }
                rows.append({column: row.get(column) for column in _columns(varied)})
            progress(done, len(frames), done / max(time.monotonic() - started, 1e-9), name)
    return _Evaluated(EvaluationTable.from_rows(rows, varied, designs_of(run)), matrices)


def _columns(varied: dict[str, str]) -> tuple[str, ...]:
    return (*(measure.name for measure in MEASURES), *varied)
