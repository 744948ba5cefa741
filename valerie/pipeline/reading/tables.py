"""From the rows of a run to its long table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from sqlalchemy import Engine

from valerie.analysis.all_classes import AllClasses, all_classes
from valerie.analysis.table import EvaluationTable
from valerie.db import results
from valerie.db.engine import reading
from valerie.labels import PERSON
from valerie.measures import OF_PERSON, Source, names_from
from valerie.metrics.aggregate import frame_mean
from valerie.metrics.matrix import SHAPE, ConfusionMatrix
from valerie.perception.base import FunctionCard
from valerie.runs.spec import ResolvedRun
from valerie.scene.variation.conditions import conditions
from valerie.storage import codecs

#: Columns of the long table that the database holds by the same name.
_STORED: Final = names_from(*OF_PERSON, Source.PERSON_SCORE, Source.FRAME_SCORE)


def frame_id(run_id: str, variant: int, camera: int, time: int = 0) -> str:
    """Name of a frame in URLs, tables and on the command line: ``run.variant.camera.time``."""
    return f"{run_id}.{variant}.{camera}.{time}"


def read_table(engine: Engine, run_id: str, resolved: ResolvedRun) -> EvaluationTable:
    """The long table of what is evaluated so far."""
    return EvaluationTable.from_rows(_rows(engine, run_id, resolved), varied_types(resolved))


def read_classes(
    engine: Engine, run_id: str, resolved: ResolvedRun, cards: Sequence[FunctionCard]
) -> tuple[AllClasses, ...]:
    """What is evaluated so far, over all classes: one entry per function and sensor setting, functions first, as in the table.

    Args:
        engine: of the database.
        run_id, resolved: the run.
        cards: of its functions, in the spec's order: they say by which classes each is judged.
    """
    totals: dict[tuple[int, int], ConfusionMatrix] = defaultdict(lambda: np.zeros(SHAPE, np.int64))
    mious: dict[tuple[int, int], list[float | None]] = defaultdict(list)
    with reading(engine) as connection:
        for sensor, function, packed, miou in results.confusions(connection, run_id):
            totals[function, sensor] += codecs.decode_counts(packed)
            mious[function, sensor].append(miou)
    functions, sensors = resolved.spec.functions, resolved.spec.sensors
    return tuple(
        all_classes(
            functions[function],
            sensors[sensor].name,
            total,
            frame_mean(mious[function, sensor]),
            cards[function].judged_by,
        )
        for (function, sensor), total in sorted(totals.items(), key=lambda item: item[0])
    )


def varied_types(resolved: ResolvedRun) -> dict[str, str]:
    """Path to type of the parameters that the run varies."""
    varied = set(resolved.space.varied)
    return {d.path: d.type.value for d in resolved.definitions if d.path in varied}


def table_row(row: Any, run_id: str, resolved: ResolvedRun, varied: dict[str, str]) -> dict[str, Any]:
    """One row of the long table from one row of the database."""
    return {
        "run_id": run_id,
        "variant_index": row.variant_index,
        "frame_id": frame_id(run_id, row.variant_index, row.camera_index, row.time_index),
        "camera": resolved.cameras[row.camera_index],
        "time_s": resolved.seconds(row.assignment, row.time_index),
        "character": character_of(row.instance_id, row.assignment, resolved),
        "sensor": resolved.spec.sensors[row.sensor_index].name,
        "function": resolved.spec.functions[row.function_index],
        "instance_id": row.instance_id or None,
        **{name: getattr(row, name) for name in _STORED},
        # A person who is not there has no counts.
        "tp": row.tp or 0,
        "fn": row.fn or 0,
        **conditions(resolved.at(row.assignment, row.time_index), resolved.manifest)._asdict(),
        **{path: row.assignment.get(path) for path in varied},
    }


def _rows(engine: Engine, run_id: str, resolved: ResolvedRun) -> Iterator[dict[str, Any]]:
    varied = varied_types(resolved)
    with reading(engine) as connection:
        for row in results.rows(connection, run_id):
            yield table_row(row, run_id, resolved, varied)


def character_of(instance_id: int, assignment: Mapping[str, Any], resolved: ResolvedRun) -> str | None:
    """Which pedestrian an instance is: the value of its CATEGORICAL parameter ``character``; None for instance 0."""
    if instance_id == 0:
        return None
    path = f"scene.{PERSON.node_class}-{instance_id % 1000}.character"
    value = assignment.get(path)
    if value is None:
        value = next((d.default for d in resolved.definitions if d.path == path), None)
    return None if value is None else str(value)
