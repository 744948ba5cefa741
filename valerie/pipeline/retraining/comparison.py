"""Versions of a function on the frames of one run: nothing is rendered, the stored frames are looked at again."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.before_after import Comparison, aligned, compare, row_keys
from valerie.analysis.region import Region
from valerie.analysis.table import EvaluationTable
from valerie.db import results
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput
from valerie.measures import MEASURES
from valerie.metrics.collection import collection_scores
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scoring import score_frame
from valerie.perception.base import PerceptionFunction
from valerie.perception.running.batches import predicted
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.pipeline.functions.references import display_name
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.reading.selection import (
    ChosenFrame,
    evaluated_rows,
    finished_frames,
    function_index,
    run_where,
)
from valerie.pipeline.reading.tables import varied_types
from valerie.pipeline.retraining.targets import run_values
from valerie.runs.frames import FrameKey
from valerie.storage import codecs


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """One version on the run's frames (first sensor setting).

    Attributes:
        table: the long table of this function alone.
        matrices: (19, 20) per frame.
    """

    table: EvaluationTable
    matrices: dict[FrameKey, ConfusionMatrix]


@dataclass(frozen=True, slots=True)
class _Version:
    """What is known of a version before it looks.

    Attributes:
        reference: names it.
        stored: whether the run evaluated it.
        numeric_class: in which the run pinned it, or in which it runs here.
        judged: train ids of the classes that it is judged by.
    """

    reference: str
    stored: bool
    numeric_class: str
    judged: frozenset[int]


def compare_versions(
    context: Context,
    run_id: str,
    references: Sequence[str],
    *,
    open_function: Callable[[str], PerceptionFunction],
    where: str = "",
    region: Region | None = None,
    mixed: bool = False,
    progress: Callable[[int, int, float, str], None] = lambda *_: None,
) -> Comparison:
    """Compare functions on a run's frames; the first is "before".

    Figures over all classes are over those that every version is judged by.

    Args:
        context: of the deployment.
        run_id: of the validation.
        references: names or function files; what the run evaluated already is read, the rest looks at the frames now.
        open_function: opens a reference.
        where: persons selected by this expression, *by the first function's scores*, form a group, the others another.
        region: persons in it form a group, the others another: unlike a selection by scores, this one does not favour
            any later version by chance alone.
        mixed: compare also what runs in unequal numeric classes, to see what precision or engine themselves change.
        progress: called after every frame with done, total, frames per second and the function.

    Raises:
        NotFound, InvalidInput, UnknownName: no such run, function or column.
        Conflict: the run has no finished frames; or versions run in unequal numeric classes and ``mixed`` is not said.
        InferenceError: a function failed.
    """
    if len(references) < 2 or len({display_name(one) for one in references}) < len(references):
        raise InvalidInput("name two or more different functions", field="versions", value=list(references))
    run = read_run(context, run_id)
    with reading(context.engine) as connection:
        frames = list(finished_frames(connection, run))
    if not frames:
        raise Conflict(f"run {run_id} has no finished frames yet")
    known = {display_name(one): _known(one, run, open_function) for one in references}
    if not mixed:  # before the frames are looked at
        _require_one_class(known)
    looked = {
        name: _stored(context, run, one.reference)
        if one.stored
        else _look(context, run, frames, one.reference, open_function, progress)
        for name, one in known.items()
    }
    tables = aligned([one.table for one in looked.values()])
    keys = sorted(set.intersection(*(set(one.matrices) for one in looked.values())))
    common = sorted(frozenset.intersection(*(one.judged for one in known.values())))
    versions = {
        name: (table, collection_scores([one.matrices[key] for key in keys], common))
        for (name, one), table in zip(looked.items(), tables, strict=True)
    }
    groups = _groups(context, run, tables[0], next(iter(looked)), where, region)
    return compare(
        versions,
        numeric_classes=[one.numeric_class for one in known.values()],
        more_groups=groups,
        threshold=run.resolved.spec.detection_threshold,
        seed=run.resolved.spec.seed,
    )


def _known(reference: str, run: StoredRun, open_function: Callable[[str], PerceptionFunction]) -> _Version:
    if reference in run.resolved.spec.functions:
        card, numeric_class = pinned_card(run.pins, reference), run.pins.functions[reference].numeric_class
        return _Version(reference, True, numeric_class, frozenset(card.judged_ids))
    function = open_function(reference)
    try:
        return _Version(reference, False, function.numeric_class, frozenset(function.card.judged_ids))
    finally:
        function.close()


def _require_one_class(versions: Mapping[str, _Version]) -> None:
    if len({one.numeric_class for one in versions.values()}) > 1:
        ran = "; ".join(
            f"{name} {'ran' if one.stored else 'runs here'} as {one.numeric_class}" for name, one in versions.items()
        )
        raise Conflict(
            f"versions of unequal numeric classes are not compared: {ran}. Let one run look with all of them "
            "(its spec may name several functions, and equal frames are not rendered again), compare where the run's "
            "workers run and with as many threads, or say --mixed to see what precision or engine themselves change"
        )


def _groups(
    context: Context,
    run: StoredRun,
    table: EvaluationTable,
    before: str,
    where: str,
    region: Region | None,
) -> dict[str, NDArray[np.bool_]]:
    """Rows that are selected, and rows in the region, each with its opposite."""
    groups: dict[str, NDArray[np.bool_]] = {}
    if not where and region is None:
        return groups
    stored = {(row["frame_id"], row["instance_id"]): row for row in table.arrow.to_pylist()}
    with reading(context.engine) as connection:
        assigned = {(row["frame_id"], row["instance_id"]): row for _, row in evaluated_rows(connection, run)}
    # The first version's scores over all that is assigned.
    rows = [{**assigned.get(key, {}), **stored[key]} for key in row_keys(table)]
    there = np.array([row["instance_id"] is not None for row in rows], np.bool_)
    if region is not None:
        inside = np.array(
            [bool(row["instance_id"]) and region.holds(run_values(row, run.resolved)) for row in rows], np.bool_
        )
        groups["in the region"], groups["outside the region"] = inside, there & ~inside
    if where:
        condition = run_where(where, run.resolved)
        chosen = np.array([condition.holds(row) for row in rows], np.bool_)
        groups[f"selected by the scores of {before}"], groups["not selected"] = chosen & there, there & ~chosen
    return groups


def _stored(context: Context, run: StoredRun, function: str) -> Looked:
    index = function_index(function, run.resolved)
    varied = varied_types(run.resolved)
    with reading(context.engine) as connection:
        rows = [row for _, row in evaluated_rows(connection, run, sensor=0, function=index)]
        predictions = results.predictions(connection, run.id, 0, index)
    table = EvaluationTable.from_rows(({name: row.get(name) for name in _columns(varied)} for row in rows), varied)
    return Looked(table, {key: codecs.decode_counts(stored.confusion) for key, stored in predictions.items()})


def _look(
    context: Context,
    run: StoredRun,
    frames: Sequence[ChosenFrame],
    reference: str,
    open_function: Callable[[str], PerceptionFunction],
    progress: Callable[[int, int, float, str], None],
) -> Looked:
    """Predict every frame in this process, and count as the evaluation stage does."""
    varied, name = varied_types(run.resolved), display_name(reference)
    reader = ProductReader(context.store)
    rows: list[dict[str, object]] = []
    matrices: dict[FrameKey, ConfusionMatrix] = {}
    function = open_function(reference)
    started = time.monotonic()
    try:
        shots = ((frame, capture_of(run.resolved, frame.stored, 0)) for frame in frames)
        taken = ((shot, shot[1].picture(reader)) for shot in shots)
        for done, ((frame, capture), labels) in enumerate(predicted(function, taken), start=1):
            truth = capture.seen_truth(reader)
            scored = score_frame(truth, labels, function.card.judged_ids)
            matrices[frame.key], scores = scored.matrix, scored.scores
            for person in frame.persons:
                seen = measured_again(person, truth) if capture.distorted else person
                counts = scored.person(person["instance_id"] or 0)
                row = {
                    **seen,
                    **{path: frame.stored.assignment.get(path) for path in varied},
                    "function": name,
                    **counts.columns,
                    **scores.columns,
                }
                rows.append({column: row.get(column) for column in _columns(varied)})
            progress(done, len(frames), done / max(time.monotonic() - started, 1e-9), name)
    finally:
        function.close()
    return Looked(EvaluationTable.from_rows(rows, varied), matrices)


def _columns(varied: dict[str, str]) -> tuple[str, ...]:
    return (*(measure.name for measure in MEASURES), *varied)
