"""Sentences about a summary: the meaning of its brackets, and its limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from valerie.analysis.findings.findings import Findings
from valerie.analysis.rows.frame_counts import ALL
from valerie.analysis.summary.summary import OCCLUDED, BlockPersons, OcclusionShare, Summary
from valerie.analysis.wording import percent, population, reasons_text, unit_noun
from valerie.statistics.intervals import Interval, Refusal, Shortfall
from valerie.statistics.units import Estimand


def occlusion_sentence(shares: Sequence[OcclusionShare]) -> str:
    """Return the occluded share of each pedestrian's views; empty without views."""
    texts = [
        f"{'all' if share.character == ALL else share.character} {percent(share.share)} % of {share.persons:,}"
        for share in shares
        if share.persons
    ]
    return f"More than {100 * OCCLUDED:g} % occluded: {', '.join(texts)}." if texts else ""


def certainty_sentences(summary: Summary) -> list[str]:
    """Return the blocks that the rows of a summary mix, the meaning of their brackets, and the reasons for missing intervals."""
    rows = summary.rows
    sentences = [blocks_sentence(summary.blocks)] if summary.blocks else []
    sentences += interval_sentences(row.pacc_mean_interval for row in rows)
    if any(row.pacc_mean_spread for row in rows):
        places = max(row.pacc_mean_spread.places for row in rows if row.pacc_mean_spread)
        sentences.append(f"[Middle 80 % of the means of {places:,} places]: how much places differ.")
    return sentences + refusal_sentences(row.pacc_mean_interval for row in rows)


def blocks_sentence(blocks: Sequence[BlockPersons]) -> str:
    """Return the part of each block in the rows of a summary, and why its pedestrians do not compare."""
    parts = [f"{percent(one.share)} % of block {one.block} ({', '.join(one.characters) or 'nobody'})" for one in blocks]
    if (rest := 1 - sum(one.share for one in blocks)) > 1e-9:
        parts.append(f"{percent(rest)} % of others")
    return (
        f"Each row mixes the blocks of the run, a person in a frame weighing the same: all together are {', '.join(parts)}. "
        "Blocks differ in more than their pedestrians: compare these within a block."
    )


def interval_sentences(intervals: Iterable[Interval | Refusal | None]) -> list[str]:
    """Return the population of intervals, once for each kind of design; empty without any."""
    most: dict[Estimand, int] = {}
    for interval in intervals:
        if isinstance(interval, Interval):
            most[interval.estimand] = max(interval.units, most.get(interval.estimand, 0))
    return [f"[95 % interval] for {population(one)}, from {units:,} {unit_noun(one)}." for one, units in most.items()]


def refusal_sentences(intervals: Iterable[Interval | Refusal | None]) -> list[str]:
    """Return the reasons for missing intervals, each once."""
    refusals = (interval for interval in intervals if isinstance(interval, Refusal))
    return [f"No confidence interval: {reason}." for reason in dict.fromkeys(map(refusal_text, refusals))]


def refusal_text(refusal: Refusal) -> str:
    """Return the reason for a missing interval."""
    units, more = f"{refusal.units} {unit_noun(refusal.estimand)}", refusal.more_units
    match refusal.reason:
        case Shortfall.LISTED:
            return (
                "the variants are listed, not drawn at random, and say nothing about what lies between them; "
                f"repeat them on {more} more sites, or draw the variants"
            )
        case Shortfall.FEW:
            return f"{units} are too few; {more} more would do"
        case Shortfall.UNEQUAL:
            return f"{units} are worth only {refusal.worth:.1f} of equal size; about {more} more would do"


def limits(summary: Summary, findings: Findings) -> list[str]:
    """Return the limits of the results."""
    first = next((interval for row in summary.rows if (interval := row.pacc_mean_interval) is not None), None)
    sentences = []
    if first is not None:
        sentences.append(f"Means apply only to {population(first.estimand)}.")
    if first is not None and first.estimand is Estimand.LISTED_GRID:
        sentences.append("All variants were listed, so the results do not apply between them or on other sites.")
    if findings.places_searched:
        places = findings.places_searched + findings.places_confirming
        sentences.append(f"The run saw {places:,} places. It cannot detect differences that need more places.")
    together = [row for row in summary.rows if row.character == ALL] or list(summary.rows)
    # Gaps depend only on visibility, so all functions have the same.
    gaps = dict.fromkeys((row.persons, reasons_text(row.undefined)) for row in together if row.undefined)
    sentences += [f"Of {persons:,} views of a person, some have no pACC: {reasons}." for persons, reasons in gaps]
    return sentences
