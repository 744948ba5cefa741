"""Groups of rows, and counts of whole frames: precision and IoU belong to a frame, never to a person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable

#: Reason of a row whose person is not in the scene.
ABSENT: Final = "absent"
#: Name of all characters together.
ALL: Final = "all"
#: Name of persons without a declared character.
UNNAMED: Final = "unnamed"


@dataclass(frozen=True, slots=True, eq=False)
class FrameCounts:
    """Person pixels of every evaluation (frame, sensor, function); all arrays (E,), in the table's numbering.

    Attributes:
        row: int64, the first row of the evaluation, which supplies the frame's own columns.
        tp, fn, fp: float64 pixels; tp and fn summed over the frame's persons.
        inhabited: bool, True where at least one person is present, visible or not.
    """

    row: NDArray[np.int64]
    tp: NDArray[np.float64]
    fn: NDArray[np.float64]
    fp: NDArray[np.float64]
    inhabited: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Group:
    """One line of a summary: a function, a sensor setting and a pedestrian (`ALL` for any)."""

    function: str
    sensor: str
    character: str


def present(table: EvaluationTable) -> NDArray[np.bool_]:
    """Return (N,) bool: the rows of persons that are in the scene, visible or not."""
    rows: NDArray[np.bool_] = ~table.codes("undefined_reason").where(ABSENT)
    return rows


def frame_counts(table: EvaluationTable) -> FrameCounts:
    """Return the sums over the rows of each evaluation."""
    number = table.evaluations
    count = int(number.max()) + 1 if len(number) else 0
    row = np.zeros(count, np.int64)
    row[number[::-1]] = np.arange(len(number))[::-1]  # the last assignment wins: the first row
    return FrameCounts(
        row=row,
        tp=np.bincount(number, weights=table.numbers("tp"), minlength=count).astype(np.float64),
        fn=np.bincount(number, weights=table.numbers("fn"), minlength=count).astype(np.float64),
        fp=table.numbers("fp")[row],
        inhabited=np.bincount(number, weights=present(table), minlength=count) > 0,
    )


def settings(table: EvaluationTable) -> tuple[tuple[str, str], ...]:
    """Return the (function, sensor) pairs that occur, sorted."""
    functions, sensors = table.codes("function"), table.codes("sensor")
    pairs = np.unique(functions.index * max(len(sensors.names), 1) + sensors.index)
    return tuple((functions.names[p // len(sensors.names)], sensors.names[p % len(sensors.names)]) for p in pairs)


def characters(table: EvaluationTable) -> tuple[str, ...]:
    """Return the characters that are present in any frame, sorted, then `UNNAMED` if a person has none."""
    codes = table.codes("character")
    occurring = np.unique(codes.index[present(table)])
    named = tuple(codes.names[i] for i in occurring if i >= 0)
    return (*named, UNNAMED) if -1 in occurring else named


def rows_of(table: EvaluationTable, group: Group) -> NDArray[np.bool_]:
    """Return (N,) bool: the rows of the group's present persons."""
    rows = present(table) & table.codes("function").where(group.function) & table.codes("sensor").where(group.sensor)
    if group.character == ALL:
        return rows
    if group.character == UNNAMED:
        return rows & (table.codes("character").index < 0)
    return rows & table.codes("character").where(group.character)


def groups(table: EvaluationTable) -> tuple[Group, ...]:
    """Return the groups of each function and sensor: one per character, then `ALL` where there are several."""
    names = characters(table)
    shown = (*names, ALL) if len(names) > 1 else names
    return tuple(Group(function, sensor, name) for function, sensor in settings(table) for name in shown)
