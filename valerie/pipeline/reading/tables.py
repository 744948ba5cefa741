"""The long table of a run from its rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa
from sqlalchemy import Engine

from valerie.analysis.comparison.wording import difference_of_specs
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.all_classes import AllClasses, all_classes
from valerie.db import long_table, results
from valerie.db import variants as stored_variants
from valerie.db.archives import reading_run
from valerie.db.long_table import LongRow, Piece
from valerie.db.models import Assignment
from valerie.errors import Conflict, InvalidInput
from valerie.labels import PERSON
from valerie.measures import CLASS_COLUMNS, Cell, Measures, TableRow
from valerie.metrics.aggregate import frame_mean
from valerie.metrics.matrix import SHAPE, ConfusionMatrix
from valerie.perception.base import FunctionCard
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run
from valerie.runs.document.differing import differing
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pins import Pins, TolerantPins
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.asset import is_generated
from valerie.scene.variation.conditions import conditions
from valerie.storage import codecs

#: Columns of a person that are empty if the frame has no person.
_PIXELS: Final = ("pixel_area", "pixel_area_percent", "pixel_area_amodal")
#: Places in a spec in which the runs of a sample differ: its sites or draws.
_OF_A_SAMPLE: Final = frozenset({"asset.seed", "seed"})


@dataclass(frozen=True, slots=True, eq=False)
class RunsTogether:
    """Several runs of the same functions as one sample, for example of one grid on several sites.

    Attributes:
        runs: the runs.
        table: their rows.
        differing: what else than the site or the draw differs between the first run and another, in words.
    """

    runs: tuple[StoredRun, ...]
    table: EvaluationTable
    differing: tuple[str, ...]


def read_table(engine: Engine, run: StoredRun) -> EvaluationTable:
    """Read the long table of all evaluations so far."""
    varied = varied_types(run.resolved)
    with reading_run(engine, run.id) as connection:
        assignments = stored_variants.assignments(connection, run.id)
        pieces = [
            EvaluationTable.from_columns(_table_columns(piece, run, assignments, varied), varied)
            for piece in long_table.pieces(connection, run.id)
        ]
    if not pieces:
        return EvaluationTable.from_rows((), varied, designs_of(run))
    return EvaluationTable(pa.concat_tables([piece.arrow for piece in pieces]), varied, designs_of(run))


def _table_columns(
    piece: Piece, run: StoredRun, assignments: Mapping[int, Assignment], varied: Iterable[str]
) -> dict[str, Sequence[Cell]]:
    """Return a piece of the long table as columns, equal to those of `table_row`.

    Columns that depend only on frame or variant are computed once for each of them.
    """
    resolved, spec = run.resolved, run.resolved.spec
    variants, cameras, times, sensors, functions, instances, measures = piece
    places = list(zip(variants, cameras, times, strict=True))
    frames = {
        (variant, camera, time): frame_columns(FrameKey(run.id, variant, camera, time), assignments[variant], resolved)
        for variant, camera, time in dict.fromkeys(places)
    }
    persons = list(zip(instances, variants, strict=True))
    characters = {
        (instance, variant): character_of(instance, assignments[variant], resolved)
        for instance, variant in dict.fromkeys(persons)
    }
    of_frames = [frames[place] for place in places]
    columns: dict[str, Sequence[Cell]] = {**measures}
    columns |= {name: [frame[name] for frame in of_frames] for name in of_frames[0]}
    columns["character"] = [characters[person] for person in persons]
    columns["instance_id"] = [instance or None for instance in instances]
    for name in _PIXELS:
        columns[name] = [value if instance else None for value, instance in zip(measures[name], instances, strict=True)]
    if isinstance(run.pins, TolerantPins):
        by_variant = {variant: run.pins.at(assignments[variant]) for variant in dict.fromkeys(variants)}
        made = [
            _classes(by_variant[variant], spec.functions[index])
            for variant, index in zip(variants, functions, strict=True)
        ]
        columns |= {name: [row[name] for row in made] for name in CLASS_COLUMNS}
    columns["sensor"] = [spec.sensors[index].name for index in sensors]
    columns["function"] = [spec.functions[index] for index in functions]
    for name in ("tp", "fn"):  # an absent person has no counts
        columns[name] = [value or 0 for value in measures[name]]
    return columns | {path: [assignments[variant].get(path) for variant in variants] for path in varied}


def read_together(context: Context, run_ids: Sequence[str]) -> RunsTogether:
    """Read several runs as one sample.

    Raises:
        NotFound: no such run.
        Conflict: a run has not started, or a function's name refers to different versions in two runs.
        InvalidInput: a run is named twice, or they vary different parameters.
    """
    if len(set(run_ids)) < len(run_ids):
        raise InvalidInput("name each run once", field="RUN", value=list(run_ids))
    stored = tuple(read_run(context, run_id) for run_id in run_ids)
    versions: dict[str, str] = {}
    for run in stored:
        for name, pin in run.pins.functions.items():
            if versions.setdefault(name, pin.digest) != pin.digest:
                raise Conflict(f"run {run.id} evaluated another version of {name} than the runs before it")
    first, *others = stored
    differences = (
        difference_of_specs(*one, own=f"in {first.id}", other=f"in {other.id}")
        for other in others
        for one in differing(first.resolved.spec, other.resolved.spec)
        if one.place not in _OF_A_SAMPLE
    )
    return RunsTogether(
        stored, EvaluationTable.joined([read_table(context.engine, run) for run in stored]), tuple(differences)
    )


def read_classes(
    engine: Engine, runs: Sequence[StoredRun], cards: Mapping[str, FunctionCard]
) -> tuple[AllClasses, ...]:
    """Read the scores over all classes of all evaluations so far.

    Args:
        engine: database.
        runs: the runs whose evaluations are taken together.
        cards: function name to its card, which states the classes that the function is judged by.

    Returns:
        One entry per function and sensor setting, functions first, as in the table.
    """
    totals: dict[tuple[str, str], ConfusionMatrix] = defaultdict(lambda: np.zeros(SHAPE, np.int64))
    mious: dict[tuple[str, str], list[float | None]] = defaultdict(list)
    for run in runs:
        names, sensors = run.resolved.spec.functions, [sensor.name for sensor in run.resolved.spec.sensors]
        with reading_run(engine, run.id) as connection:
            for sensor, function, packed, miou in results.confusions(connection, run.id):
                totals[names[function], sensors[sensor]] += codecs.decode_counts(packed)
                mious[names[function], sensors[sensor]].append(miou)
    specs = [run.resolved.spec for run in runs]
    settings = dict.fromkeys(
        (name, sensor.name) for spec in specs for name in spec.functions for sensor in spec.sensors
    )
    return tuple(
        all_classes(name, sensor, totals[name, sensor], frame_mean(mious[name, sensor]), cards[name].judged_by)
        for name, sensor in settings
        if (name, sensor) in totals
    )


def designs_of(run: StoredRun) -> dict[str, Design]:
    """Return run id to the design of the run's variants."""
    space, asset = run.resolved.space, run.resolved.spec.asset
    blocks = tuple((block.design, size) for block, size in zip(space.blocks, space.block_sizes, strict=True))
    name, seed = (asset, 0) if isinstance(asset, str) else (str(asset["name"]), int(asset.get("seed", 0)))
    return {run.id: Design(blocks, seed if is_generated(name) else None)}


def varied_types(resolved: ResolvedRun) -> dict[str, str]:
    """Return path to type of the parameters that the run varies."""
    varied = set(resolved.space.varied)
    return {d.path: d.type.value for d in resolved.definitions if d.path in varied}


def table_row(row: LongRow, run: StoredRun, varied: Iterable[str]) -> TableRow:
    """Return one row of the long table.

    Args:
        row: the stored row.
        run: the run.
        varied: paths of the parameters that get a column.
    """
    spec = run.resolved.spec
    return {
        **frame_columns(row.frame, row.assignment, run.resolved),
        **person_columns(row.instance_id, row.measures, row.assignment, run.resolved),
        "sensor": spec.sensors[row.sensor_index].name,
        "function": spec.functions[row.function_index],
        # An absent person has no counts.
        "tp": row.measures["tp"] or 0,
        "fn": row.measures["fn"] or 0,
        **{path: row.assignment.get(path) for path in varied},
        **class_columns(row.assignment, spec.functions[row.function_index], run.pins),
    }


def class_columns(assignment: Assignment, function: str, pins: Pins) -> TableRow:
    """Return the numeric classes that made a row, if the run accepts several."""
    return _classes(pins.at(assignment), function) if isinstance(pins, TolerantPins) else {}


def _classes(pins: Pins, function: str) -> TableRow:
    offers = (pins.engine, pins.truth, pins.functions[function])
    return {name: offer.numeric_class for name, offer in zip(CLASS_COLUMNS, offers, strict=True)}


def frame_columns(key: FrameKey, assignment: Assignment, resolved: ResolvedRun) -> TableRow:
    """Return the columns of a row that identify its frame, and those of the conditions."""
    return {
        "run_id": key.run_id,
        "variant_index": key.variant,
        "frame_id": str(key),
        "camera": resolved.cameras[key.camera],
        "time_s": resolved.seconds(assignment, key.time),
        **conditions(resolved.at(assignment, key.time), resolved.manifest)._asdict(),
    }


def person_columns(instance_id: int, measures: Measures, assignment: Assignment, resolved: ResolvedRun) -> TableRow:
    """Return the columns of a row about a person."""
    return {
        "character": character_of(instance_id, assignment, resolved),
        "instance_id": instance_id or None,
        **measures,
        **(dict.fromkeys(_PIXELS) if instance_id == 0 else {}),
    }


def character_of(instance_id: int, assignment: Assignment, resolved: ResolvedRun) -> str | None:
    """Return an instance's pedestrian, its CATEGORICAL parameter ``character``; None for instance 0."""
    if instance_id == 0:
        return None
    path = f"scene.{PERSON.node_class}-{instance_id % 1000}.character"
    value = assignment.get(path)
    if value is None:
        value = next((d.default for d in resolved.definitions if d.path == path), None)
    return None if value is None else str(value)
