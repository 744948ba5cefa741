"""Verdicts on a run's requirements, from its rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from sqlalchemy import Connection

from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.verdicts.verdicts import RequirementVerdict, judge_requirements
from valerie.db import long_table
from valerie.db.archives import reading_run
from valerie.labels import PERSON
from valerie.measures import TableRow
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.pipeline.reading.selection import evaluated_persons, values_at
from valerie.pipeline.reading.tables import character_of, designs_of, frame_columns, person_columns
from valerie.scene.assets.attributes import ABSENT


def read_verdicts(context: Context, run: StoredRun, table: EvaluationTable) -> tuple[RequirementVerdict, ...]:
    """Judge the requirements of a run whose products are all done or failed.

    Args:
        context: context of the deployment.
        run: the run.
        table: its long table of all evaluations.
    """
    resolved = run.resolved
    if not resolved.requirements:
        return ()
    regional = [requirement for requirement in resolved.requirements if requirement.where is not None]
    with reading_run(context.engine, run.id) as connection:
        verdict_rows = [
            [requirement.holds(person.row) for requirement in regional]
            for person in (evaluated_persons(connection, run) if regional else ())
        ]
        lost = list(_lost_rows(connection, run))
    inside = np.array(verdict_rows, np.bool_).reshape(len(verdict_rows), len(regional))
    return judge_requirements(
        resolved.requirements,
        table,
        designs_of(run)[run.id],
        regions={requirement.document.id: inside[:, i] for i, requirement in enumerate(regional)},
        lost=lost,
        threshold=resolved.spec.detection_threshold,
    )


def _lost_rows(connection: Connection, run: StoredRun) -> Iterator[TableRow]:
    """Yield the rows that failed for good; if the truth failed too, one for each person that may be present."""
    resolved = run.resolved
    spec = resolved.spec
    nodes = [person.rpartition("-")[2] for person in resolved.manifest.persons]
    instances = [PERSON.id * 1000 + int(number) for number in nodes]
    for row in long_table.lost_rows(connection, run.id):
        common = {
            **values_at(row.frame, row.assignment, resolved),
            **frame_columns(row.frame, row.assignment, resolved),
            "sensor": spec.sensors[row.sensor_index].name,
            "function": spec.functions[row.function_index],
        }
        if row.instance_id is not None:
            yield {**common, **person_columns(row.instance_id, row.measures, row.assignment, resolved)}
            continue
        characters = {instance: character_of(instance, row.assignment, resolved) for instance in instances}
        present = [instance for instance, character in characters.items() if character != ABSENT]
        unknown: TableRow = dict.fromkeys(("pixel_area", "undefined_reason"))
        yield from ({**common, **unknown, "instance_id": n, "character": characters[n]} for n in present)
        if not present:
            yield {**common, **unknown, "instance_id": None, "character": None, "undefined_reason": ABSENT}
