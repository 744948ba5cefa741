"""Rows that two runs or versions have in common, and the groups of rows in which they are compared."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from valerie.analysis.rows.binning import bin_edges
from valerie.analysis.rows.frame_counts import characters
from valerie.analysis.rows.levels import unit_after
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.parameters.paths import short_name
from valerie.runs.products.frame_keys import FrameKey

#: Identity of a row; rows of two tables with equal keys are compared.
RowKey = tuple[Hashable, ...]

#: Columns that identify a person in a frame, for two functions of a run.
SAME_FRAME: Final = ("frame_id", "sensor", "instance_id")
#: Columns that do so for two runs, together with the varied parameters.
SAME_MOMENT: Final = ("camera", "time_s", "sensor", "instance_id")
_DISTANCE_BIN_M: Final = 10.0
_OCCLUSION: Final = (
    ("not occluded (≤ 5 %)", -1.0, 0.05),
    ("occluded 5–50 %", 0.05, 0.5),
    ("occluded > 50 %", 0.5, 1.0),
)
#: A parameter with more levels than the first number is divided into the second number of parts with about equally many rows.
_MOST_LEVELS, _PARTS = 8, 4


def row_keys(
    table: EvaluationTable, *columns: Sequence[Hashable], frames: Sequence[Hashable] | None = None
) -> list[RowKey]:
    """Return (frame, *columns, instance) of every row.

    Args:
        table: of one function and one sensor setting, unless ``columns`` distinguish them.
        columns: (N,) each, such as the sensors.
        frames: (N,) names that equal frames of both tables share; None: the frame ids.
    """
    names = table.arrow["frame_id"].to_pylist() if frames is None else frames
    return list(zip(names, *columns, table.arrow["instance_id"].to_pylist(), strict=True))


def frames_of_any_run(table: EvaluationTable) -> list[FrameKey]:
    """Return the frame of every row without its run: equal for equal frames of runs with the same variants."""
    codes = table.codes("frame_id")
    frames = [replace(FrameKey.parse(name), run_id="") for name in codes.names]
    return [frames[code] for code in codes.index.tolist()]


def paired_rows(keys: Sequence[RowKey], others: Sequence[RowKey]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the (M,) rows of each table whose keys are equal, in the order of the first."""
    row_of = {key: row for row, key in enumerate(others)}
    pairs = [(row, row_of[key]) for row, key in enumerate(keys) if key in row_of]
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    return first, second


@dataclass(frozen=True, slots=True)
class HeldParameters:
    """The parameters of two runs that are matched across some of them.

    Attributes:
        values: path to a value of each run.
        varying: path to the id of a run that has several values.
    """

    values: Mapping[str, tuple[object, object]]
    varying: Mapping[str, str]

    @property
    def own(self) -> list[str]:
        """The paths that each run holds at a value of its own."""
        return [path for path, (here, there) in self.values.items() if path not in self.varying and here != there]

    def paths(self, names: Sequence[str], *, field: str) -> list[str]:
        """Return the paths of parameters that neither run varies.

        Args:
            names: their names or paths.
            field: of the names.

        Raises:
            InvalidInput: a parameter is unknown, or varies inside a run.
        """
        known = {name: path for path in self.values for name in (path, short_name(path))}
        for name in names:
            path = known.get(name, "")
            if path and path not in self.varying:
                continue
            message = f"varies inside run {self.varying[path]}" if path else "no parameter of these runs"
            own = ", ".join(map(short_name, self.own)) or "none"
            raise InvalidInput(f"{message}; each run holds at a value of its own: {own}", field=field, value=name)
        return [known[name] for name in names]


def rows_taken(table: EvaluationTable, rows: ArrayLike) -> EvaluationTable:
    """Return the table of the rows with these numbers, in their order."""
    return EvaluationTable(table.arrow.take(np.asarray(rows, np.int64)), table.parameters, table.designs)


def aligned(tables: Sequence[EvaluationTable]) -> list[EvaluationTable]:
    """Return the tables reduced to the rows that all have, in the order of the first.

    Args:
        tables: one function and one sensor setting each.
    """
    keys = [row_keys(table) for table in tables]
    common = set(keys[0]).intersection(*keys[1:])
    order = [key for key in keys[0] if key in common]
    return [rows_taken(table, paired_rows(order, own)[1]) for table, own in zip(tables, keys, strict=True)]


def parts_of(table: EvaluationTable, counting: NDArray[np.bool_]) -> dict[str, NDArray[np.bool_]]:
    """Return the groups by distance, occlusion, character, camera and the levels of every varied parameter: name to (N,) bool.

    Left out are groups with none or all of the counting rows, and those with the same ones as an earlier group, such as a
    character that is varied.

    Args:
        table: N rows.
        counting: (N,) True for the rows that count.
    """
    parts = _distance_bands(table)
    occlusion = table.numbers("occlusion_rate")
    for name, low, high in _OCCLUSION:
        parts[name] = (occlusion > low) & (occlusion <= high)
    for kind, names in (("character", characters(table)), ("camera", table.codes("camera").names)):
        if len(names) > 1:
            parts |= {f"{kind} {name}": table.codes(kind).where(name) for name in names}
    parts |= _all_levels(table)
    seen = {(rows & counting).tobytes() for rows in (~counting, counting)}
    distinct = {}
    for name, rows in parts.items():
        if (own := (rows & counting).tobytes()) not in seen:
            seen.add(own)
            distinct[name] = rows
    return distinct


def levels_of(table: EvaluationTable) -> dict[str, NDArray[np.bool_]]:
    """Return the groups by distance and by the levels of every varied parameter: name to (N,) bool."""
    return _distance_bands(table) | _all_levels(table)


def _distance_bands(table: EvaluationTable) -> dict[str, NDArray[np.bool_]]:
    """Return the bands with at least one row; rows with undefined distance are in none."""
    distance = table.numbers("distance_m")
    defined = distance[np.isfinite(distance)]
    if not len(defined):
        return {}
    edges = bin_edges(float(defined.min()), float(defined.max()), _DISTANCE_BIN_M)
    bands = {
        f"distance {low:g}–{high:g} m": (distance >= low) & (distance < high) for low, high in pairwise(edges.tolist())
    }
    return {name: rows for name, rows in bands.items() if rows.any()}


def _all_levels(table: EvaluationTable) -> dict[str, NDArray[np.bool_]]:
    return {
        f"{short_name(path)} {name}": rows
        for path, kind in table.parameters.items()
        for name, rows in _levels(table, path, kind).items()
    }


def _levels(table: EvaluationTable, path: str, kind: str) -> dict[str, NDArray[np.bool_]]:
    if kind == "CATEGORICAL":
        codes = table.codes(path)
        return {name: codes.where(name) for name in codes.names}
    values = table.numbers(path)
    levels = np.unique(values[np.isfinite(values)])
    if kind == "BOOL":
        return {("false", "true")[int(level)]: values == level for level in levels.tolist()}
    unit = unit_after(path, kind)
    if len(levels) <= _MOST_LEVELS:
        return {f"{level:g}{unit}": values == level for level in levels.tolist()}
    edges = np.unique(np.quantile(values[np.isfinite(values)], np.linspace(0, 1, _PARTS + 1)))
    parts = {}
    for low, high in pairwise(edges.tolist()):
        below = values <= high if high == edges[-1] else values < high
        parts[f"{low:.4g} to {high:.4g}{unit}"] = (values >= low) & below
    return parts
