"""Open explorations of runs from their final tables, or from the database while a run is active, and cache the last few."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from threading import Lock
from time import monotonic
from typing import Final

import numpy as np
import pyarrow as pa
from cachetools import LRUCache

from valerie.analysis.rows.frame_counts import ABSENT
from valerie.analysis.rows.table import PARAMETER_COLUMNS, EvaluationTable, without_codes
from valerie.db import runs
from valerie.db.engine import reading
from valerie.db.runs import RunRow
from valerie.errors import InvalidInput
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.base.run_artifacts import TABLE_PARQUET
from valerie.pipeline.exploring.exploration import MAX_ROWS, Exploration
from valerie.pipeline.reading.tables import read_table
from valerie.runs.products.states import Stage
from valerie.runs.resolving.spec import ResolvedRun
from valerie.storage.keys import run_key

#: Most rows of all cached explorations together.
_KEPT_ROWS: Final = MAX_ROWS
#: Most runs of an exploration: a study has one for each batch.
MAX_RUNS: Final = 100
#: Shortest time between two reads of an active run, seconds.
_FRESH_SECONDS: Final = 30.0


@dataclass(frozen=True, slots=True)
class _Kept:
    version: tuple[object, ...]
    read_at: float
    exploration: Exploration


class Explorations:
    """The explorations of one process."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._lock = Lock()
        self._kept: LRUCache[tuple[str, ...], _Kept] = LRUCache(_KEPT_ROWS, lambda kept: len(kept.exploration) + 1)

    def open(self, run_ids: Sequence[str]) -> Exploration:
        """Return the combined rows of runs; a parameter that a run does not vary has the run's constant or its default.

        Raises:
            NotFound: no such run.
            Conflict: an asset changed.
            InvalidInput: a run is named twice, there are too many runs or rows, or a parameter has different types.
        """
        key = tuple(run_ids)
        if len(set(key)) < len(key) or len(key) > MAX_RUNS:
            raise InvalidInput("name each run once", field="run", value=list(key), limit=f"{MAX_RUNS} runs")
        with self._lock:
            with reading(self._context.engine) as connection:
                rows = [runs.get(connection, run_id) for run_id in key]
            version = tuple((row.state, row.progress.stages[Stage.EVAL].done if row.progress else 0) for row in rows)
            entry = self._kept.get(key)
            if entry is not None and (entry.version == version or monotonic() - entry.read_at < _FRESH_SECONDS):
                return entry.exploration
            exploration = self._read(rows)
            # `Exploration` refuses to be larger than the cache.
            self._kept[key] = _Kept(version, monotonic(), exploration)
            return exploration

    def _read(self, rows: Sequence[RunRow]) -> Exploration:
        tables: list[tuple[EvaluationTable, ResolvedRun]] = []
        units: dict[str, str] = {}
        for row in rows:
            stored = resolve_stored(row, self._context.settings)
            units |= {d.path: d.unit_sign for d in stored.resolved.definitions}
            key = run_key(row.id, TABLE_PARQUET)
            if row.finished_at is not None and self._context.store.exists(key):
                table = EvaluationTable.from_parquet(pa.BufferReader(self._context.store.get(key)))
            else:
                table = read_table(self._context.engine, stored)
            tables.append((table, stored.resolved))
        return Exploration(_present(_together(tables)), units=units, read_at=datetime.now(UTC))


def _together(tables: Sequence[tuple[EvaluationTable, ResolvedRun]]) -> EvaluationTable:
    if len(tables) == 1:
        return tables[0][0]
    parameters: dict[str, str] = {}
    for table, _ in tables:
        for path, kind in table.parameters.items():
            if parameters.setdefault(path, kind) != kind:
                raise InvalidInput("the parameter has different types in these runs", field=path, value=kind)
    designs = {run: design for table, _ in tables for run, design in table.designs.items()}
    joined = pa.concat_tables([_filled(table, parameters, run) for table, run in tables])
    return EvaluationTable(joined, parameters, designs)


def _filled(table: EvaluationTable, parameters: Mapping[str, str], run: ResolvedRun) -> pa.Table:
    """Return the columns with one per parameter: what a variant does not set is the run's constant or the default."""
    definitions, varied = run.space.definitions, run.space.varied
    values = {path: definition.default for path, definition in definitions.items()}
    values |= {path: value for path, value in run.space.constants[0].items() if path not in varied}
    arrow = table.arrow.replace_schema_metadata(None)  # it differs between runs
    for path, kind in parameters.items():
        of = without_codes(PARAMETER_COLUMNS[kind])
        known = path in definitions and definitions[path].type == kind
        value = pa.scalar(values[path] if known else None, of)
        if path not in table.parameters:
            arrow = arrow.append_column(path, pa.repeat(value, len(table)))
        elif value.is_valid and arrow[path].null_count:
            arrow = arrow.set_column(arrow.column_names.index(path), path, arrow[path].cast(of).fill_null(value))
    return EvaluationTable(arrow, parameters).arrow


def _present(table: EvaluationTable) -> EvaluationTable:
    """Return the rows without persons that are absent from the scene; frames without persons keep their row."""
    absent = table.codes("undefined_reason").where(ABSENT) & np.isfinite(table.numbers("instance_id"))
    return table.select(~absent) if absent.any() else table  # a copy of a large table takes a second
