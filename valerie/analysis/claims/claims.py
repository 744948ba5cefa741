"""A ledger of claims: tests each statement of a paper, a data sheet or a colleague on a run.

Claims are documents (`examples/claims/paper.yaml`). A claim names its rows and its test; the ledger computes the quantity
with its interval and answers *reproduced*, *not reproduced*, *undecided* (with the reason) or *not testable here*.
Differences are paired within places (`valerie.statistics.contrasts`). No rows both choose and test: a trend is tested without
choosing a shape (`valerie.statistics.curves.proven_changes`), and the shape of the curve whose band places a threshold
(`departure`) is chosen by other places. The largest flip is counted over all pairs, which needs no test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from typing import Annotated, Final, Literal, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from valerie.analysis.rows.levels import Factor, factors_of
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.wording import points
from valerie.document import Document
from valerie.errors import UnknownName
from valerie.runs.resolving.where import compile_where
from valerie.statistics.confirmation import halves
from valerie.statistics.contrasts import Change, Contrast, contrasts, largest_flips
from valerie.statistics.curves import departure, fit_curve, proven_changes
from valerie.statistics.intervals import Interval, mean_interval
from valerie.statistics.observations import Observations, dense, observe
from valerie.statistics.units import Estimand
from valerie.validation import problems_of

#: Confidence of each interval of the ledger, not adjusted for the others.
LEVEL: Final = 0.95
#: Largest possible difference of two bins' averages for which a score counts as level.
LEVEL_WITHIN: Final = 0.1

Text = Annotated[str, Field(min_length=1, max_length=2_000)]
Name = Annotated[str, Field(min_length=1, max_length=128)]
Number = Annotated[float, Field(allow_inf_nan=False)]


Statistic = Literal["mean", "minimum", "maximum", "share"]


class QuantityTest(Document):
    """A statistic of the rows is in a range: their mean, smallest or largest value, or the share above a value."""

    of: Name
    statistic: Statistic = "mean"
    above: Number | None = None
    low: Number | None = None
    high: Number | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.statistic == "share") != (self.above is not None):
            raise ValueError("`above` belongs to a share, and a share needs it")
        if self.low is None and self.high is None:
            raise ValueError("needs `low`, `high` or both")
        return self


class DifferenceTest(Document):
    """The score at one level of a factor minus that at another, everything else equal.

    ``sign`` is ``>``, ``<`` or ``=``; for ``=`` the interval must be within ± ``within``.
    """

    factor: Name
    first: Name
    second: Name
    sign: Literal["<", ">", "="]
    within: Annotated[float, Field(gt=0, lt=1)] = 0.05


class DepartureTest(Document):
    """The score stays level up to ``at`` on an axis and then changes by more than ``by``."""

    over: Name
    at: Number
    tolerance: Annotated[float, Field(ge=0)]
    by: Annotated[float, Field(gt=0, lt=1)] = 0.1


class TrendTest(Document):
    """The score rises, falls or stays level over an axis."""

    over: Name
    shape: Literal["rising", "falling", "level"]


class FlipTest(Document):
    """Some pair of rows that differs only in one factor differs in its score by at least ``at_least``."""

    factor: Name
    first: Name
    second: Name
    at_least: Annotated[float, Field(gt=0, le=1)]


class Claim(Document):
    """One statement and its test.

    Attributes:
        id: identifies the claim.
        source: place in the source, such as ``6.2.2``.
        says: the statement in the source's words.
        where: expression that selects its rows; empty: all.
        without: rows of blocks that set one of these parameters are left out; None: those of the document.
        functions: the functions that it is about; empty: every function of the run.
        quantity, difference, departure, trend, flip: the test.
        untestable: instead of a test, the reason why a run cannot test it.
        slip: instead of a test, the reason why the statement must be an error of the source.
    """

    id: Name
    source: str = ""
    says: Text
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    functions: tuple[Name, ...] = ()
    quantity: QuantityTest | None = None
    difference: DifferenceTest | None = None
    departure: DepartureTest | None = None
    trend: TrendTest | None = None
    flip: FlipTest | None = None
    untestable: str = ""
    slip: str = ""

    @model_validator(mode="after")
    def _one_test(self) -> Self:
        tests = ("quantity", "difference", "departure", "trend", "flip", "untestable", "slip")
        if sum(bool(getattr(self, name)) for name in tests) != 1:
            raise ValueError(f"needs exactly one of {', '.join(tests)}")
        return self


class Printed(Document):
    """A number that the source prints, which the report compares with the run's.

    Attributes:
        source: place in the source, such as ``table 2``.
        what: description.
        of, statistic, above: the number, as in `Quantity`.
        value: as printed, in the column's unit.
        where, without, functions: as in `Claim`.
    """

    source: str = ""
    what: Text
    of: Name
    statistic: Statistic = "mean"
    above: Number | None = None
    value: Number
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    functions: tuple[Name, ...] = ()


class Cross(Document):
    """Pictures of one view under the levels of two factors, everything else equal.

    Attributes:
        source: place in the source that shows such pictures.
        title: heading.
        down, across: the factors.
        where, without: selection of the rows that may be shown, as in `Claim`.
        published: the source's own table, line by line; the first line is the head.
    """

    source: str = ""
    title: Text
    down: Name
    across: Name
    where: str = Field(default="", max_length=2_000)
    without: tuple[Name, ...] | None = None
    published: tuple[tuple[str | Number, ...], ...] = ()


class Claims(Document):
    """A document of claims.

    Attributes:
        title: title of the source.
        source: reference to the source.
        without: parameters that the source does not vary: rows of blocks that set one are left out, unless a claim, number
            or cross says otherwise.
        claims: its statements.
        numbers: numbers that it prints.
        crosses: pictures like those that it shows.
    """

    title: Text
    source: str = ""
    without: tuple[Name, ...] = ()
    claims: Annotated[tuple[Claim, ...], Field(min_length=1, max_length=1_000)]
    numbers: Annotated[tuple[Printed, ...], Field(max_length=1_000)] = ()
    crosses: Annotated[tuple[Cross, ...], Field(max_length=100)] = ()


class ClaimOutcome(StrEnum):
    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    NOT_TESTABLE = "not testable here"
    SLIP = "slip of the source"


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


def parse_claims(document: object) -> Claims:
    """Check a document of claims.

    Raises:
        InvalidInputs: every problem of the document, with its place.
    """
    try:
        return Claims.model_validate(document)
    except ValidationError as error:
        raise problems_of(error) from None


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


def ledger_text(claims: Claims, entries: Sequence[LedgerEntry]) -> str:
    """Return the ledger as a Markdown table, and below it what its intervals are for."""

    def cell(text: str) -> str:
        return text.replace("|", "\\|").replace("\n", " ")

    lines = [f"# {claims.title}", "", claims.source, "", "| | Claim | Function | Outcome | What the run shows |"]
    lines.append("|---|---|---|---|---|")
    for entry in entries:
        cells = (entry.source, entry.says, entry.function, str(entry.outcome), entry.finding)
        lines.append(f"| {' | '.join(map(cell, cells))} |")
    lines += ["", *ledger_notes(entries)]
    return "\n".join(lines) + "\n"


def ledger_notes(entries: Sequence[LedgerEntry]) -> list[str]:
    """Return what the quantities, and the intervals of differences and curves, are over."""
    return [
        f"Quantities are those of {estimand.population}; intervals of differences and along an axis are for "
        f"{estimand.population_of_differences}, 95 % each."
        for estimand in dict.fromkeys(entry.estimand for entry in entries)
        if estimand is not None
    ]


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
        return replace(entry, finding=f"no row has {test.of}")
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
    population = test.of if test.above is None else f"{test.of} > {test.above:g}"
    claimed = " and ".join(
        f"{sign} {bound:g}" for sign, bound in (("≥", test.low), ("≤", test.high)) if bound is not None
    )
    return replace(
        entry,
        outcome=outcome,
        finding=f"{test.statistic}({population}) is {estimate:.4g}; claimed {claimed}",
        estimate=estimate, low=low, high=high,
        rows=int(np.count_nonzero(rows)), places=len(np.unique(table.places[rows])),
    )  # fmt: skip


def _difference(
    test: DifferenceTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], field: str
) -> LedgerEntry:
    contrast, _ = _contrast(test, table, rows, field)
    if contrast is None:
        return replace(entry, finding=f"no place shows both {test.first} and {test.second}, everything else equal")
    low, high = contrast.interval(LEVEL)
    if test.sign == "=":
        held, against = max(abs(low), abs(high)) <= test.within, low > test.within or high < -test.within
    else:
        held, against = (low > 0, high < 0) if test.sign == ">" else (high < 0, low > 0)
    outcome = ClaimOutcome.REPRODUCED if held else ClaimOutcome.NOT_REPRODUCED if against else ClaimOutcome.UNDECIDED
    finding = (
        f"{test.factor} {test.first} less {test.second}: {points(contrast.estimate)} points "
        f"({points(low)} to {points(high)}; {contrast.matching}, {contrast.pairs:,} pairs)"
    )
    return replace(
        entry, outcome=outcome, finding=finding, estimate=contrast.estimate, low=low, high=high,
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
        finding=f"the largest change of {test.factor} alone, from {test.second} to {test.first}, is {points(largest)} points "
        f"({contrast.pairs:,} pairs)",
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
    observations = observe(values, table.places, {name: each.codes for name, each in factors.items()})
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
    )
    if curve is None:
        return replace(entry, finding=f"too few places for a curve over {test.over}")
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
    best = "never" if left.estimate is None else f"at {left.estimate:.3g}"
    certain = [f"not before {not_before:.3g}"] if not_before is not None else []
    certain += [f"at {at_latest:.3g} at the latest"] if at_latest is not None else []
    finding = (
        f"pACC leaves its first level by {100 * test.by:g} points {best}"
        + (f" ({', '.join(certain)})" if certain else " (the band is too wide to say when)")
        + f"; claimed {test.at:g} ± {test.tolerance:g}"
    )
    return replace(
        entry, outcome=outcome, finding=finding, estimate=left.estimate, low=not_before, high=at_latest,
        rows=curve.rows, places=curve.places,
    )  # fmt: skip


def _trend(
    test: TrendTest, entry: LedgerEntry, table: EvaluationTable, rows: NDArray[np.bool_], seed: int
) -> LedgerEntry:
    changes = proven_changes(table.numbers(test.over)[rows], table.numbers("pacc")[rows], table.places[rows], seed=seed)
    if changes is None:
        return replace(entry, finding=f"too few places for averages over {test.over}")
    shapes = {(False, False): "", (True, False): "; falls somewhere", (False, True): "; rises somewhere"}
    shown = shapes.get((changes.falls, changes.rises), "; falls and rises")
    falls, rises = changes.high < 0, changes.low > 0
    if test.shape == "level":
        held, against = changes.most <= LEVEL_WITHIN, falls or rises or changes.falls or changes.rises
    elif test.shape == "rising":
        held, against = rises and not changes.falls, falls or changes.falls
    else:
        held, against = falls and not changes.rises, rises or changes.rises
    outcome = ClaimOutcome.REPRODUCED if held else ClaimOutcome.NOT_REPRODUCED if against else ClaimOutcome.UNDECIDED
    bins = changes.bins
    finding = (
        f"pACC over {test.over}: the last third less the first is {points(changes.difference)} points "
        f"({points(changes.low)} to {points(changes.high)}){shown}; {100 * bins.mean[0]:.1f} % at {bins.centre[0]:.3g}, "
        f"{100 * bins.mean[-1]:.1f} % at {bins.centre[-1]:.3g}"
    )
    return replace(
        entry,
        outcome=outcome,
        finding=finding,
        estimate=changes.difference,
        low=changes.low,
        high=changes.high,
        rows=sum(bins.rows),
        places=changes.places,
    )
