"""A ledger of claims: tests each claim on a run.

A claim names its rows and its test; the ledger computes the quantity with its interval and answers *reproduced*,
*not reproduced*, *undecided* (with the reason) or *not testable here*. Differences are paired within places
(`valerie.statistics.contrasts`). No rows both choose and test: a trend is tested without choosing a shape
(`valerie.statistics.curves.proven_changes`), and the shape of the curve whose band places a threshold (`departure`) is chosen
by other places. Where neighbouring places of one site are alike (`valerie.statistics.neighbours`), these have no interval
and the claim stays undecided, with the plain figure of the listed places. The largest flip is counted over all pairs, which
needs no test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.claims.claims import (
    Claim,
    Claims,
    Cross,
    DepartureTest,
    DifferenceTest,
    FlipTest,
    Printed,
    QuantityTest,
    Statistic,
    TrendTest,
)
from valerie.analysis.claims.wording import (
    departure_sentence,
    difference_sentence,
    flip_sentence,
    quantity_sentence,
    title_of,
    trend_sentence,
)
from valerie.analysis.rows.levels import Factor, factors_of
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import UnknownName
from valerie.runs.resolving.where import compile_where
from valerie.statistics.confirmation import halves
from valerie.statistics.contrasts import Change, Contrast, contrasts, largest_flips
from valerie.statistics.curves import departure, fit_curve, proven_changes
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.observations import Observations, dense, observe
from valerie.statistics.units import Estimand

#: Confidence of each interval of the ledger, not adjusted for the others.
LEVEL: Final = 0.95
#: Largest possible difference of two bins' averages for which a score counts as level.
LEVEL_WITHIN: Final = 0.1


class ClaimOutcome(StrEnum):
    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    NOT_TESTABLE = "not testable here"
    SLIP = "slip of the source"

    @property
    def decided(self) -> bool:
        """True if the run answers the claim."""
        return self in (ClaimOutcome.REPRODUCED, ClaimOutcome.NOT_REPRODUCED)


@dataclass(frozen=True, slots=True)
class LedgerEntry:
    """One line of the ledger.

    Attributes:
        id, source, says: as in `Claim`.
        function: the tested function; empty for a claim about frames only.
        outcome: answer.
        finding: result of the run in words.
        estimate, low, high: the quantity and its interval; None if there is none.
        estimand: what they are over.
        rows, places: numbers that the estimate is computed from.
        frames: ids of the frames of the largest flip, before and after.
    """

    id: str
    source: str
    says: str
    function: str
    outcome: ClaimOutcome
    finding: str
    estimate: float | None = None
    low: float | None = None
    high: float | None = None
    rows: int = 0
    places: int = 0
    estimand: Estimand | None = None
    frames: tuple[str, ...] = ()


def write_ledger(claims: Claims, table: EvaluationTable, *, seed: int = 0) -> tuple[LedgerEntry, ...]:
    """Test every claim on a run.

    Args:
        claims: the document.
        table: the run's evaluations.
        seed: of the curves.

    Raises:
        InvalidInput, UnknownName: a claim names a column, function or level that the run does not have, with its field.
            A claim about a factor that the run does not vary is not testable here.
    """
    entries: list[LedgerEntry] = []
    factors = {factor.name: factor for factor in factors_of(table)}
    for i, claim in enumerate(claims.claims):
        field = f"claims.{i}"
        untestable = claim.untestable
        if (compared := claim.difference or claim.flip) is not None and compared.factor not in factors:
            untestable = f"The run does not vary {compared.factor}; it varies {', '.join(factors) or 'nothing'}."
        if claim.slip or untestable:
            outcome = ClaimOutcome.SLIP if claim.slip else ClaimOutcome.NOT_TESTABLE
            entries.append(LedgerEntry(claim.id, claim.source, claim.says, "", outcome, claim.slip or untestable))
            continue
        rows = rows_of(claims, claim, table, field)
        names = table.codes("function").names
        for name in claim.functions:
            if name not in names:
                raise UnknownName("function", name, names, field=f"{field}.functions")
        about_frames = claim.quantity is not None and not is_score(claim.quantity.of)
        for name in claim.functions or (names[:1] if about_frames else names):
            own = rows & table.codes("function").where(name)
            entry = LedgerEntry(
                claim.id,
                claim.source,
                claim.says,
                "" if about_frames else name,
                ClaimOutcome.UNDECIDED,
                "",
                estimand=table.units.estimand,
            )
            entries.append(_test(claim, entry, table, own, field, seed))
    return tuple(entries)


def ledger_table(entries: Sequence[LedgerEntry]) -> pa.Table:
    """Return the ledger as a table, one row per entry."""
    return pa.Table.from_pylist(
        [
            {
                **asdict(entry),
                "outcome": str(entry.outcome),
                "estimand": None if entry.estimand is None else entry.estimand.value,
                "frames": " ".join(entry.frames),
            }
            for entry in entries
        ],
        schema=pa.schema([(field.name, _NUMBERS.get(field.name, pa.string())) for field in fields(LedgerEntry)]),
    )


_NUMBERS: Final = {
    "estimate": pa.float64(), "low": pa.float64(), "high": pa.float64(), "rows": pa.int64(), "places": pa.int64(),
}  # fmt: skip


def is_score(column: str) -> bool:
    """Return True if the values of a column depend on the function under test."""
    return bool(compile_where(f"{column} == {column}").scored)


def rows_of(claims: Claims, part: Claim | Printed | Cross, table: EvaluationTable, field: str) -> NDArray[np.bool_]:
    """Return (N,) bool: the rows that a part of a document is about.

    Raises:
        InvalidInput, UnknownName: its selection cannot be evaluated; the problem names ``field``.
    """
    rows = np.ones(len(table), np.bool_)
    if part.where:
        where = compile_where(part.where, field=f"{field}.where")
        columns = table.arrow.select(sorted(where.names)).to_pylist()
        rows = np.fromiter((where.holds(row) for row in columns), np.bool_, len(table))
    for name in claims.without if part.without is None else part.without:
        # A block that does not set a parameter leaves its column empty.
        rows &= np.logical_and.reduce(
            [table.codes(path).index < 0 for path in table.parameters if path in (name, f"scene.{name}")],
            initial=True,
        )
    return rows


def _test(
    claim: Claim, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], field: str, seed: int
) -> LedgerEntry:
    if claim.quantity is not None:
        return _quantity(claim.quantity, entry, table, rows)
    if claim.difference is not None:
        return _difference(claim.difference, entry, table, rows, f"{field}.difference")
    if claim.departure is not None:
        return _departure(claim.departure, entry, table, rows, seed)
    if claim.trend is not None:
        return _trend(claim.trend, entry, table, rows, seed)
    assert claim.flip is not None
    return _flip(claim.flip, entry, table, rows, f"{field}.flip")


def statistic_of(values: NDArray[np.float64], statistic: Statistic, above: float | None) -> float:
    """Return the mean, smallest or largest of some values, or the share of them above a value."""
    if above is not None:
        return float(np.mean(values > above))
    return float({"minimum": np.min, "maximum": np.max}.get(statistic, np.mean)(values))


def _quantity(test: QuantityTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_]) -> LedgerEntry:
    values = table.numbers(test.of)
    rows = rows & np.isfinite(values)
    if not rows.any():
        return replace(entry, finding=f"no row has {title_of(test.of)}")
    scores = values[rows] if test.above is None else (values[rows] > test.above).astype(np.float64)
    estimate = statistic_of(values[rows], test.statistic, test.above)
    low = high = None
    if test.statistic in ("mean", "share") and scores.min() >= 0 and scores.max() <= 1:
        interval = mean_interval(scores, table.units.of(rows))
        if isinstance(interval, Interval):
            low, high = interval.low, interval.high
    least, most = (-np.inf if test.low is None else test.low), (np.inf if test.high is None else test.high)
    inside = least <= estimate <= most
    if inside:
        outcome = ClaimOutcome.REPRODUCED
    elif low is not None and high is not None and high >= least and low <= most:
        outcome = ClaimOutcome.UNDECIDED
    else:
        outcome = ClaimOutcome.NOT_REPRODUCED
    return replace(
        entry,
        outcome=outcome,
        finding=quantity_sentence(test, estimate),
        estimate=estimate, low=low, high=high,
        rows=int(np.count_nonzero(rows)), places=len(np.unique(table.places[rows])),
    )  # fmt: skip


def _difference(
    test: DifferenceTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], field: str
) -> LedgerEntry:
    contrast, _ = _contrast(test, table, rows, field)
    if contrast is None:
        return replace(entry, finding=f"no place shows both {test.first} and {test.second}, everything else equal")
    low, high = np.clip(contrast.interval(LEVEL), -1.0, 1.0).tolist()
    if test.sign == "=":
        held, against = max(abs(low), abs(high)) <= test.within, low > test.within or high < -test.within
    else:
        held, against = (low > 0, high < 0) if test.sign == ">" else (high < 0, low > 0)
    outcome = ClaimOutcome.REPRODUCED if held else ClaimOutcome.NOT_REPRODUCED if against else ClaimOutcome.UNDECIDED
    return replace(
        entry, outcome=outcome, finding=difference_sentence(test, contrast, low, high),
        estimate=contrast.estimate, low=None if contrast.alike else low, high=None if contrast.alike else high,
        rows=2 * contrast.pairs, places=contrast.places,
    )  # fmt: skip


def _flip(
    test: FlipTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], field: str
) -> LedgerEntry:
    contrast, observations = _contrast(test, table, rows, field)
    if contrast is None:
        return replace(entry, finding=f"no pair shows {test.first} and {test.second}, everything else equal")
    pacc, largest, pair = table.numbers("pacc"), 0.0, None
    for direction in (contrast, replace(contrast, estimate=-contrast.estimate)):
        for before, after in largest_flips(observations, direction, 1).tolist():
            if abs(pacc[after] - pacc[before]) > abs(largest):
                largest, pair = float(pacc[after] - pacc[before]), (before, after)
    held = abs(largest) >= test.at_least
    frames = table.codes("frame_id")
    return replace(
        entry,
        outcome=ClaimOutcome.REPRODUCED if held else ClaimOutcome.NOT_REPRODUCED,
        finding=flip_sentence(test, largest, contrast.pairs),
        estimate=largest, rows=2 * contrast.pairs, places=contrast.places,
        frames=() if pair is None else tuple(frames.names[frames.index[row]] for row in pair),
    )  # fmt: skip


def _contrast(
    test: DifferenceTest | FlipTest, table: EvaluationTable, rows: NDArray[np.bool_], field: str
) -> tuple[Contrast | None, Observations]:
    """Return the contrast of the first level to the second, and the rows that it was computed from."""
    factors = {factor.name: factor for factor in factors_of(table)}
    factor = factors[test.factor]
    before, after = _level(factor, test.second, f"{field}.second"), _level(factor, test.first, f"{field}.first")
    values = np.where(rows, table.numbers("pacc"), np.nan)
    codes = {name: each.codes for name, each in factors.items()}
    observations = observe(values, table.places, codes, table.place_positions)
    # Contrasts go from the lower level to the higher one.
    changes = contrasts(
        observations, interactions=False, only=[(Change(test.factor, min(before, after), max(before, after)),)]
    )
    if not changes or changes[0].degrees <= 0:
        return None, observations
    contrast = changes[0]
    if before > after:
        contrast = contrast.reversed
    return contrast, observations


def _level(factor: Factor, name: str, field: str) -> int:
    if name not in factor.levels:
        raise UnknownName(f"level of {factor.name}", name, factor.levels, field=field)
    return factor.levels.index(name)


def _departure(
    test: DepartureTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], seed: int
) -> LedgerEntry:
    # The shape decides how much the band may assume, so other places choose it.
    place, occurring = dense(table.places[rows])
    curve = fit_curve(
        table.numbers(test.over)[rows],
        table.numbers("pacc")[rows],
        place,
        seed=seed,
        choosing=halves(len(occurring), seed)[place],
        positions=table.positions_of(rows),
    )
    if curve is None:
        return replace(entry, finding=f"too few places for a curve over {title_of(test.over)}")
    left = departure(curve, test.by)
    not_before, at_latest = left.not_before, left.at_latest
    reached = at_latest is not None and at_latest <= test.at + test.tolerance
    held = not_before is not None and not_before >= test.at - test.tolerance
    if held and reached:
        outcome = ClaimOutcome.REPRODUCED
    elif (at_latest is not None and at_latest < test.at - test.tolerance) or (
        not_before is not None and not_before > test.at + test.tolerance
    ):
        outcome = ClaimOutcome.NOT_REPRODUCED
    else:
        outcome = ClaimOutcome.UNDECIDED
    return replace(
        entry, outcome=outcome, finding=departure_sentence(test, left, alike=not curve.low),
        estimate=left.estimate, low=not_before, high=at_latest, rows=curve.rows, places=curve.places,
    )  # fmt: skip


def _trend(
    test: TrendTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], seed: int
) -> LedgerEntry:
    own = table.numbers(test.over)[rows], table.numbers("pacc")[rows], table.places[rows]
    changes = proven_changes(*own, seed=seed, positions=table.positions_of(rows))
    if changes is None:
        return replace(entry, finding=f"too few places for averages over {title_of(test.over)}")
    falls, rises = changes.high < 0, changes.low > 0
    if test.shape == "level":
        held, against = changes.most <= LEVEL_WITHIN, falls or rises or changes.falls or changes.rises
    elif test.shape == "rising":
        held, against = rises and not changes.falls, falls or changes.falls
    else:
        held, against = falls and not changes.rises, rises or changes.rises
    outcome = ClaimOutcome.REPRODUCED if held else ClaimOutcome.NOT_REPRODUCED if against else ClaimOutcome.UNDECIDED
    return replace(
        entry,
        outcome=outcome,
        finding=trend_sentence(test, changes),
        estimate=changes.difference,
        low=None if changes.alike else changes.low,
        high=None if changes.alike else changes.high,
        rows=sum(changes.bins.rows),
        places=changes.places,
    )
