"""A source's numbers beside the run's, and views of the run under the levels of two factors.

The document of claims names both (`valerie.analysis.claims.claims`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.claims.claims import Claims, Cross
from valerie.analysis.claims.ledger import is_score, rows_of, statistic_of
from valerie.analysis.rows.levels import Factor, factors_of
from valerie.analysis.rows.table import EvaluationTable, combine
from valerie.errors import UnknownName


@dataclass(frozen=True, slots=True)
class NumberBeside:
    """A printed number and that of the run, both in the column's unit.

    Attributes:
        source, what: of the printed number.
        function: the function under test; empty for a number about frames only.
        column: column of the number.
        share: True where it is a share of rows.
        printed: number of the source.
        here: number of the run; None if no row has a value.
        rows: number of rows behind ``here``.
    """

    source: str
    what: str
    function: str
    column: str
    share: bool
    printed: float
    here: float | None
    rows: int


class CrossView(NamedTuple):
    """One cell of a `CrossExample`: the frame, and pACC by function."""

    down: str
    across: str
    frame_id: str
    sensor: str
    pacc: dict[str, float]


@dataclass(frozen=True, slots=True)
class CrossExample:
    """One person at one place under the levels of two factors, everything else equal.

    Attributes:
        cross: the request.
        down, across: levels that are shown.
        views: row by row.
        places: number of views that show all these levels and could have been chosen.
        change: largest change of pACC between two levels of ``down``; the choice maximises it.
        occlusion: of the person; None if undefined.
    """

    cross: Cross
    down: tuple[str, ...]
    across: tuple[str, ...]
    views: tuple[CrossView, ...]
    places: int
    change: float
    occlusion: float | None


def numbers_beside(claims: Claims, table: EvaluationTable) -> tuple[NumberBeside, ...]:
    """Return every printed number of a document with that of the run, one entry per function that it is about.

    Raises:
        InvalidInput, UnknownName: a number names a column or function that the run does not have, with its field.
    """
    entries = []
    functions = table.codes("function").names
    for i, number in enumerate(claims.numbers):
        field = f"numbers.{i}"
        for name in number.functions:
            if name not in functions:
                raise UnknownName("function", name, functions, field=f"{field}.functions")
        values = table.numbers(number.of)
        rows = rows_of(claims, number, table, field) & np.isfinite(values)
        of_frames = not is_score(number.of)
        for name in number.functions or (functions[:1] if of_frames else functions):
            own = values[rows & table.codes("function").where(name)]
            here = statistic_of(own, number.statistic, number.above) if len(own) else None
            shown = "" if of_frames else name
            share = number.above is not None
            entries.append(
                NumberBeside(number.source, number.what, shown, number.of, share, number.value, here, len(own))
            )
    return tuple(entries)


def cross_examples(claims: Claims, table: EvaluationTable) -> tuple[CrossExample, ...]:
    """Return an example for each cross of a document; crosses without a view are left out, as where a factor does not vary.

    Raises:
        InvalidInput, UnknownName: a cross names a column that the run does not have, with its field.
    """
    factors = {factor.name: factor for factor in factors_of(table)}
    examples = []
    for i, cross in enumerate(claims.crosses):
        if not factors.keys() >= {cross.down, cross.across}:
            continue
        rows = rows_of(claims, cross, table, f"crosses.{i}")
        if (example := _example(cross, table, rows, factors)) is not None:
            examples.append(example)
    return tuple(examples)


def _example(
    cross: Cross, table: EvaluationTable, rows: NDArray[np.bool_], factors: dict[str, Factor]
) -> CrossExample | None:
    """Return the view whose pACC changes most between two levels of ``down`` at equal ``across``."""
    down, across = factors[cross.down], factors[cross.across]
    pacc = table.numbers("pacc")
    others = [factor.codes for name, factor in factors.items() if name not in (cross.down, cross.across)]
    instance = np.nan_to_num(table.numbers("instance_id"))
    usable = np.flatnonzero(rows & np.isfinite(pacc))
    view = combine([*others, instance, table.codes("sensor").index])[usable]
    cell = down.codes * len(across.levels) + across.codes
    functions = table.codes("function")
    shape = len(functions.names), len(down.levels), len(across.levels)
    order = np.argsort(view, kind="stable")
    starts = np.flatnonzero(np.diff(view[order], prepend=-1))[1:]
    best: tuple[float, _Shown] | None = None
    count = 0
    for own in np.split(usable[order], starts):
        score = np.full(shape[0] * shape[1] * shape[2], np.nan)
        score[functions.index[own] * shape[1] * shape[2] + cell[own]] = pacc[own]
        complete = np.isfinite(score.reshape(shape)).all(axis=0)
        downs = np.flatnonzero(complete.sum(axis=1) > 0)
        acrosses = np.flatnonzero(complete[downs].all(axis=0)) if len(downs) > 1 else downs[:0]
        if len(acrosses) < 2:
            continue
        count += 1
        change = np.ptp(score.reshape(shape)[:, downs][:, :, acrosses], axis=1).max(axis=0)
        if best is None or change.max() > best[0]:
            # The level where `down` matters most, and the one where it matters least.
            ends = sorted({int(acrosses[change.argmax()]), int(acrosses[change.argmin()])})
            ends = ends if len(ends) == 2 else acrosses[:2].tolist()
            best = float(change.max()), _Shown(own, downs.tolist(), ends)
    if best is None:
        return None
    change_of_best, shown = best
    views = [
        _view(table, shown.rows[cell[shown.rows] == d * shape[2] + a], down.levels[d], across.levels[a])
        for d in shown.down
        for a in shown.across
    ]
    occlusion = float(table.numbers("occlusion_rate")[shown.rows[0]])
    return CrossExample(
        cross,
        tuple(down.levels[d] for d in shown.down),
        tuple(across.levels[a] for a in shown.across),
        tuple(views),
        count,
        change_of_best,
        occlusion if np.isfinite(occlusion) else None,
    )


class _Shown(NamedTuple):
    """The rows of one view, and its levels that are shown."""

    rows: NDArray[np.int64]
    down: list[int]
    across: list[int]


def _view(table: EvaluationTable, rows: NDArray[np.int64], down: str, across: str) -> CrossView:
    people = table.arrow.take(rows).select(["frame_id", "sensor", "function", "pacc"]).to_pylist()
    scores = {row["function"]: row["pacc"] for row in people}
    return CrossView(down, across, people[0]["frame_id"], people[0]["sensor"], scores)
