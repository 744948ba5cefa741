"""Verdicts on the requirements of a run, from its long table.

The method follows from the design that drew the variants of the region (`valerie.statistics.verdicts`): listed variants are
counted, random ones tested unit by unit, and evenly spread ones judged by their replicates. A unit is a variant with all its
rows. Rows that failed for good count at their worst: against *met* and against *not met*.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from valerie.analysis.rows.design import Design
from valerie.analysis.rows.frame_counts import frame_counts, present
from valerie.analysis.rows.table import EvaluationTable
from valerie.measures import Row, measure_of
from valerie.runs.resolving.requirements import Requirement
from valerie.statistics.replicates import MIN_POINTS, replicate_number
from valerie.statistics.units import EVEN, INDEPENDENT, LISTED
from valerie.statistics.verdicts import Basis, Outcome, Verdict, judge_even, judge_grid, judge_sample

_DISTANCE: Final = measure_of("distance_m")


@dataclass(frozen=True, slots=True)
class DistanceBand:
    """Numbers of judged and of missed persons at distances of ``low`` to ``high`` metres."""

    low: float
    high: float
    persons: int
    missed: int


@dataclass(frozen=True, slots=True)
class RequirementVerdict:
    """The verdict on one requirement and one function. Rates are 0…1, None if undefined.

    Attributes:
        id, text, statistic, where, confidence: of the requirement.
        function: name of the function.
        outcome: met, not met or undecided.
        reason: why it is undecided; empty otherwise.
        further: further variants in the region that would decide if the estimate is right; None if it is decided or no
            affordable number suffices. For a listed grid, the rows that are missing.
        quantity, sign, bound: the bounded quantity and its bound: ``share(pacc >= 0.5)``, ``>=``, 0.95.
        estimate: estimate of the quantity.
        worst, best: the quantity if all rows that failed for good fall short, and if none does.
        basis: population of the verdict; None if it was not judged.
        method: method of judgement in words.
        units: variants that were judged.
        decided_after: variants after which the sequential test ended; None if it did not or there was none.
        of: kind of a row, ``persons`` or ``frames``.
        rows: number of judged rows.
        undefined: reason to number of the rows in the region that have no value.
        too_small: persons in the region with fewer visible pixels than the requirement asks for.
        lost: rows that may be in the region and whose evaluation failed for good.
        threshold: pACC below which a person counts as missed; None for scores of frames.
        missed: missed persons by distance; empty for scores of frames.
    """

    id: str
    text: str
    statistic: str
    where: str
    confidence: float
    function: str
    outcome: Outcome
    reason: str
    further: int | None
    quantity: str
    sign: str
    bound: float
    estimate: float | None
    worst: float | None
    best: float | None
    basis: Basis | None
    method: str
    units: int
    decided_after: int | None
    of: str
    rows: int
    undefined: dict[str, int]
    too_small: int
    lost: int
    threshold: float | None
    missed: tuple[DistanceBand, ...]


def judge_requirements(
    requirements: Iterable[Requirement],
    table: EvaluationTable,
    design: Design,
    *,
    regions: Mapping[str, NDArray[np.bool_]] | None = None,
    lost: Sequence[Row] = (),
    threshold: float = 0.5,
) -> tuple[RequirementVerdict, ...]:
    """Judge the requirements of a run, each for each of its functions.

    Args:
        requirements: requirements of the run.
        table: its evaluations.
        design: design of its variants.
        regions: id of a requirement to (N,) bool, the rows of the table in its region; default: all rows.
        lost: rows whose evaluation failed for good: column or parameter path to value, None if unknown.
        threshold: detection threshold t, 0 < t ≤ 1.
    """
    everything = np.ones(len(table), np.bool_)
    return tuple(
        _judge(
            requirement,
            function,
            _judged_rows(requirement, function, table, (regions or {}).get(requirement.document.id, everything)),
            _lost_variants(requirement, function, lost),
            design,
            threshold,
        )
        for requirement in requirements
        for function in requirement.functions
    )


def verdict_table(verdicts: Sequence[RequirementVerdict]) -> pa.Table:
    """Return verdicts as a table, one row each, with the numbers of undefined and of missed persons."""
    rows = [
        {
            **{field.name: getattr(verdict, field.name) for field in fields(verdict)},
            "outcome": str(verdict.outcome),
            "basis": None if verdict.basis is None else str(verdict.basis),
            "undefined": sum(verdict.undefined.values()),
            "missed": sum(band.missed for band in verdict.missed) if verdict.of == "persons" else None,
        }
        for verdict in verdicts
    ]
    return pa.Table.from_pylist(rows, schema=_SCHEMA)


_NUMBERS: Final = ("confidence", "bound", "estimate", "worst", "best", "threshold")
_COUNTS: Final = ("further", "units", "decided_after", "rows", "undefined", "too_small", "lost", "missed")
_SCHEMA: Final = pa.schema(
    [
        (name, pa.float64() if name in _NUMBERS else pa.int64() if name in _COUNTS else pa.string())
        for name in (field.name for field in fields(RequirementVerdict))
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows of one function in a region; all arrays (N,), only rows with a value.

    Attributes:
        values: values of the measure.
        variants: index of each row's variant.
        pacc, distance: of persons; empty for frames.
        undefined, too_small: as in `RequirementVerdict`.
    """

    values: NDArray[np.float64]
    variants: NDArray[np.int64]
    pacc: NDArray[np.float64]
    distance: NDArray[np.float64]
    undefined: dict[str, int]
    too_small: int = 0


def _judged_rows(requirement: Requirement, function: str, table: EvaluationTable, region: NDArray[np.bool_]) -> _Rows:
    measure = requirement.statistic.measure
    variants = table.numbers("variant_index").astype(np.int64)
    own = table.codes("function").where(function) & region
    if not requirement.statistic.of_persons:
        rows = frame_counts(table).row[np.unique(table.evaluations[own])]
        values = table.numbers(measure.name)[rows]
        known = np.isfinite(values)
        gaps = int(np.count_nonzero(~known))
        nothing = np.empty(0)
        return _Rows(
            values[known], variants[rows][known], nothing, nothing, {f"without {measure.title}": gaps} if gaps else {}
        )
    own &= present(table)
    pacc = table.numbers("pacc")
    defined = own & np.isfinite(pacc)
    reasons = table.codes("undefined_reason")
    undefined = Counter(reasons.names[i] for i in reasons.index[own & ~defined].tolist())
    large = defined & (table.numbers("pixel_area") >= requirement.document.min_visible_pixels)
    return _Rows(
        table.numbers(measure.name)[large],
        variants[large],
        pacc[large],
        table.numbers("distance_m")[large],
        dict(sorted(undefined.items())),
        int(np.count_nonzero(defined & ~large)),
    )


def _lost_variants(requirement: Requirement, function: str, lost: Sequence[Row]) -> NDArray[np.int64]:
    """Return the variant of each lost row that may be in the region."""
    rows = [row for row in lost if row["function"] == function and not requirement.excludes(row)]
    if not requirement.statistic.of_persons:
        frames = {(row["frame_id"], row["sensor"]): row["variant_index"] for row in rows}
        return np.array(list(frames.values()), np.int64)
    pixels = requirement.document.min_visible_pixels
    return np.array(
        [
            row["variant_index"]
            for row in rows
            if row["undefined_reason"] is None and (row["pixel_area"] is None or int(row["pixel_area"]) >= pixels)
        ],
        np.int64,
    )


def _judge(
    requirement: Requirement,
    function: str,
    rows: _Rows,
    lost: NDArray[np.int64],
    design: Design,
    threshold: float,
) -> RequirementVerdict:
    document, statistic = requirement.document, requirement.statistic
    scores = statistic.scores(rows.values)
    variants = np.concatenate([rows.variants, lost])
    units = len(np.unique(variants))
    missed_below = None
    if statistic.of_persons:
        of_pacc = statistic.measure.name == "pacc" and statistic.condition is not None
        missed_below = statistic.condition[1] if of_pacc and statistic.condition else threshold
    unjudged = RequirementVerdict(
        id=document.id,
        text=document.text,
        statistic=document.statistic,
        where=document.where,
        confidence=document.confidence,
        function=function,
        outcome=Outcome.UNDECIDED,
        reason="",
        further=None,
        quantity=statistic.quantity,
        sign=statistic.sign,
        bound=statistic.bound,
        estimate=None,
        worst=None,
        best=None,
        basis=None,
        method="not judged",
        units=units,
        decided_after=None,
        of="persons" if statistic.of_persons else "frames",
        rows=len(scores),
        undefined=rows.undefined,
        too_small=rows.too_small,
        lost=len(lost),
        threshold=missed_below,
        missed=() if missed_below is None else _missed(rows, missed_below),
    )
    if not units:
        return replace(unjudged, reason=f"the region has no {unjudged.of} with a value")
    method = _method(requirement, design, variants)
    if method.judge is None:
        return replace(unjudged, reason=method.text)
    worst, best, observed = (
        method.judge(np.concatenate([scores, np.full(len(lost), score)])) for score in (0.0, 1.0, np.nan)
    )
    outcome = Outcome.UNDECIDED
    if worst.outcome is Outcome.MET:
        outcome = Outcome.MET
    elif best.outcome is Outcome.NOT_MET:
        outcome = Outcome.NOT_MET
    ends = [_shown(requirement, verdict.estimate) for verdict in (worst, best)] if len(lost) else [None, None]
    judged = replace(
        unjudged,
        outcome=outcome,
        estimate=_shown(requirement, observed.estimate),
        worst=ends[0],
        best=ends[1],
        basis=worst.basis,
        method=method.text,
        decided_after={Outcome.MET: worst, Outcome.NOT_MET: best}.get(outcome, worst).decided_after,
    )
    if units < document.min_units:
        missing = document.min_units - units
        reason = f"a verdict needs {document.min_units:,} variants"
        return replace(judged, outcome=Outcome.UNDECIDED, reason=reason, further=missing, decided_after=None)
    if outcome is not Outcome.UNDECIDED:
        return judged
    reason, further = _open(worst, best, statistic.at_least, len(lost))
    return replace(judged, decided_after=None, reason=reason, further=further)


def _open(worst: Verdict, best: Verdict, at_least: float, lost: int) -> tuple[str, int | None]:
    """Return why a requirement is undecided, and how many further variants would decide it."""
    failed = "the failed rows would decide it", lost if worst.basis is Basis.GRID else None
    leading = worst if worst.estimate >= at_least else best
    if worst.estimate < at_least <= best.estimate or leading.outcome is not Outcome.UNDECIDED:
        return failed
    if leading.further is None:
        return "the estimate is too near to the bound for any affordable number of variants", None
    return "the variants are too few for this estimate", leading.further


def _shown(requirement: Requirement, mean: float) -> float | None:
    return None if np.isnan(mean) else requirement.statistic.shown(mean)


@dataclass(frozen=True, slots=True)
class _Method:
    """A method of judging scores in words and as a function; without a function, the reason why there is no verdict."""

    text: str
    judge: Callable[[NDArray[np.float64]], Verdict] | None = None


def _method(requirement: Requirement, design: Design, variants: NDArray[np.int64]) -> _Method:
    """Choose the method by the blocks of the variants in the region."""
    at_least, confidence = requirement.statistic.at_least, requirement.document.confidence
    blocks = [design.block(number) for number in np.unique(design.blocks_of(variants)).tolist()]
    if all(name in LISTED for name, _, _ in blocks):
        return _Method("counted", partial(_count, at_least=at_least))
    if len(blocks) > 1:
        return _Method(
            "the region spans several blocks, and not all of them list their variants, so they are no sample of one "
            "space: restrict the region to one block, or give each block its own run"
        )
    ((name, first, size),) = blocks
    if name in INDEPENDENT or (name in EVEN and size < MIN_POINTS):
        return _Method(
            f"sequential test by variant, {100 * confidence:g} % confidence at any number of variants",
            partial(judge_sample, units=variants, at_least=at_least, confidence=confidence),
        )
    if name in EVEN:
        number = replicate_number(size)
        return _Method(
            f"interval over {number} replicates, {100 * confidence:g} % confidence at this number of variants",
            partial(
                judge_even,
                units=variants,
                replicate=(variants - first) % number,
                at_least=at_least,
                confidence=confidence,
            ),
        )
    return _Method(f"the way in which the design {name} draws its variants is unknown")


def _count(scores: NDArray[np.float64], *, at_least: float) -> Verdict:
    return judge_grid(scores, at_least=at_least)


def _missed(rows: _Rows, threshold: float) -> tuple[DistanceBand, ...]:
    width = _DISTANCE.bin_width
    assert width is not None, "the report plots distances"
    known = np.isfinite(rows.distance)
    band = np.floor(rows.distance[known] / width).astype(np.int64)
    missed = rows.pacc[known] < threshold
    return tuple(
        DistanceBand(
            float(number * width),
            float((number + 1) * width),
            int(np.count_nonzero(band == number)),
            int(np.count_nonzero(missed[band == number])),
        )
        for number in np.unique(band).tolist()
    )
