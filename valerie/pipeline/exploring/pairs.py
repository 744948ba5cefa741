"""Match rows of two functions or two runs by variant, and rows that differ in a single parameter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.comparison.before_after import version_scores
from valerie.analysis.rows.frame_counts import frame_counts
from valerie.analysis.rows.pairing import SAME_FRAME, SAME_MOMENT, HeldParameters
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import UnknownName
from valerie.parameters.constraints import Sql, quoted
from valerie.pipeline.exploring.exploration import ROW, Exploration, Selection
from valerie.statistics.gates import compare_versions


class PairOutcome(StrEnum):
    """Change of a person from the first side to the second; found means pACC ≥ the threshold.

    The last two are of any person, found or not, that the second side scores lower or higher.
    """

    FIXED = "fixed"
    BROKEN = "broken"
    BOTH_MISSED = "both missed"
    BOTH_FOUND = "both found"
    LOWER = "lower"
    HIGHER = "higher"


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a comparison: a function in a run."""

    run: str
    function: str


@dataclass(frozen=True, slots=True)
class Pair:
    """Two rows by their numbers, with the pACC of each."""

    before: int
    after: int
    pacc_before: float
    pacc_after: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """The matched rows of two sides.

    Attributes:
        rows: numbers of selected rows with a pACC, by side.
        matched: number of pairs.
        outcomes: pairs by outcome.
        difference: mean pACC of the second side minus that of the first, over places; None without pairs.
        low, high: its interval with 95 % confidence.
        places: number of places behind it.
        precision, iou: of each side's frames that show a matched person, from pooled counts; None without any.
        pairs: the pairs of the requested outcome that differ most.
        held: paths of the varied parameters that each run holds at a value of its own, across which rows can match.
    """

    rows: tuple[int, int]
    matched: int
    outcomes: dict[PairOutcome, int]
    difference: float | None
    low: float | None
    high: float | None
    places: int
    precision: tuple[float | None, float | None]
    iou: tuple[float | None, float | None]
    pairs: list[Pair]
    held: list[str]


@dataclass(frozen=True, slots=True)
class Swing:
    """Two rows that differ in a single parameter."""

    parameter: str
    pair: Pair


def compare_sides(
    exploration: Exploration,
    selection: Selection,
    before: Side,
    after: Side,
    *,
    threshold: float,
    outcome: PairOutcome,
    limit: int,
    across: Sequence[str] = (),
) -> Comparison:
    """Match the rows of two sides: by frame within a run, otherwise by varied parameters, camera and time.

    Args:
        exploration: the rows.
        selection: selected rows; applies to the first side.
        before, after: the sides.
        threshold: t of the detection rate.
        outcome: outcome of the pairs to return.
        limit: most pairs to return.
        across: names or paths of varied parameters that each run holds at a value of its own; rows match across them.

    Raises:
        UnknownName: a side is not among the rows.
        InvalidInput: a parameter of ``across`` is unknown or varies inside a run.
    """
    for field, side in (("before", before), ("after", after)):
        for kind, name in (("run", side.run), ("function", side.function)):
            known = exploration.table.codes("run_id" if kind == "run" else "function").names
            if name not in known:
                raise UnknownName(f"{kind} of these rows", name, known, field=field)
    runs = before.run, after.run
    # Within a run, frames match, and there is nothing to offer; reading the columns takes time.
    held = _held(exploration.table, runs) if across or before.run != after.run else HeldParameters({}, {})
    crossed = held.paths(across, field="across")
    varied = (path for path in exploration.table.parameters if path not in crossed)
    keys = SAME_FRAME if before.run == after.run else (*SAME_MOMENT, *varied)
    columns = ", ".join(quoted(name) for name in (ROW, "pacc", *keys))
    of = "run_id = ? AND function = ? AND pacc IS NOT NULL"
    same = " AND ".join(f"a.{quoted(key)} IS NOT DISTINCT FROM b.{quoted(key)}" for key in keys)
    joined = exploration.query(
        Sql(
            f"WITH a AS (SELECT {columns} FROM rows WHERE {of} AND {selection.sql.text}), "
            f"b AS (SELECT {columns} FROM rows WHERE {of}) "
            f"SELECT a.{quoted(ROW)} AS a, b.{quoted(ROW)} AS b, a.pacc AS pa, b.pacc AS pb FROM a JOIN b ON {same}",
            (before.run, before.function, *selection.sql.values, after.run, after.function),
        )
    )
    a, b = (joined[name].to_numpy().astype(np.int64) for name in "ab")
    pa_, pb = joined["pa"].to_numpy(), joined["pb"].to_numpy()
    hit, hit_after = pa_ >= threshold, pb >= threshold
    masks = {
        PairOutcome.FIXED: ~hit & hit_after, PairOutcome.BROKEN: hit & ~hit_after,
        PairOutcome.BOTH_MISSED: ~hit & ~hit_after, PairOutcome.BOTH_FOUND: hit & hit_after,
        PairOutcome.LOWER: pb < pa_, PairOutcome.HIGHER: pb > pa_,
    }  # fmt: skip
    # Largest change first; among persons that both sides missed, the lowest scores.
    weight = pa_ + pb if outcome is PairOutcome.BOTH_MISSED else -np.abs(pb - pa_)
    chosen = np.flatnonzero(masks[outcome])
    chosen = chosen[np.argsort(weight[chosen], kind="stable")[:limit]]
    places = exploration.table.places[a]
    everything = {"all": np.ones(len(a), np.bool_)}
    positions = exploration.table.positions_of(a)
    (verdict,) = compare_versions(pa_, pb, places, everything, threshold=threshold, positions=positions).slices
    table, counts = exploration.table, frame_counts(exploration.table)
    first, second = (
        version_scores(table, counts, rows, np.unique(table.evaluations[rows]), threshold) for rows in (a, b)
    )
    defined = np.isfinite(exploration.table.numbers("pacc"))
    return Comparison(
        rows=(_rows_of(exploration, before, defined & selection.rows), _rows_of(exploration, after, defined)),
        matched=len(a),
        outcomes={name: int(np.count_nonzero(mask)) for name, mask in masks.items()},
        difference=verdict.difference if verdict.pairs else None,
        low=verdict.low,
        high=verdict.high,
        places=verdict.places,
        precision=(first.precision_pooled, second.precision_pooled),
        iou=(first.iou_pooled, second.iou_pooled),
        pairs=_pairs(zip(a[chosen], b[chosen], pa_[chosen], pb[chosen], strict=True)),
        held=held.own,
    )


def _held(table: EvaluationTable, runs: tuple[str, str]) -> HeldParameters:
    """Return the varied parameters of both runs."""
    values: dict[str, tuple[object, object]] = {}
    varying = {}
    masks = [pa.array(table.codes("run_id").where(run)) for run in runs]
    for path in table.parameters:
        here, there = (table.arrow[path].filter(mask).unique().to_pylist() for mask in masks)
        values[path] = (here[0], there[0])
        if len(here) > 1 or len(there) > 1:
            varying[path] = runs[len(here) <= 1]
    return HeldParameters(values, varying)


def largest_swings(exploration: Exploration, selection: Selection, *, limit: int) -> list[Swing]:
    """Return the pairs of selected rows that differ in one varied parameter only, largest change of pACC first.

    Args:
        exploration: the rows.
        selection: the selected rows.
        limit: most pairs of each parameter.
    """
    parameters = list(exploration.table.parameters)
    swings = []
    for parameter in parameters:
        others = ("run_id", "function", *SAME_MOMENT, *(path for path in parameters if path != parameter))
        column, row = quoted(parameter), quoted(ROW)
        extremes = exploration.query(
            Sql(
                f"SELECT arg_max({row}, pacc) AS a, arg_min({row}, pacc) AS b, max(pacc) AS pa, min(pacc) AS pb FROM rows "
                f"WHERE pacc IS NOT NULL AND {selection.sql.text} GROUP BY {', '.join(map(quoted, others))} "
                f"HAVING count(DISTINCT {column}) > 1 AND pa > pb ORDER BY pa - pb DESC, a LIMIT {int(limit)}",
                selection.sql.values,
            )
        )
        swings += [Swing(parameter, pair) for pair in _pairs(_columns(extremes))]
    return sorted(swings, key=lambda swing: swing.pair.pacc_after - swing.pair.pacc_before)


def _rows_of(exploration: Exploration, side: Side, rows: NDArray[np.bool_]) -> int:
    table = exploration.table
    of = table.codes("run_id").where(side.run) & table.codes("function").where(side.function)
    return int(np.count_nonzero(of & rows))


def _columns(table: pa.Table) -> Iterable[tuple[int, int, float, float]]:
    return zip(*(table[name].to_pylist() for name in ("a", "b", "pa", "pb")), strict=True)


def _pairs(columns: Iterable[tuple[int, int, float, float]]) -> list[Pair]:
    return [Pair(int(a), int(b), float(x), float(y)) for a, b, x, y in columns]
