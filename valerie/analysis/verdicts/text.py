"""Verdicts in words, for the terminal, the report and test results."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.analysis.wording import counted, percent, reasons_text
from valerie.runs.statistic import parse_statistic
from valerie.statistics.verdicts import Basis, Outcome

_STYLES = {Outcome.MET: "bold green", Outcome.NOT_MET: "bold red", Outcome.UNDECIDED: "bold yellow"}
_WORDS = {">=": "at least", "<=": "at most"}
_SIGNS = {">=": "≥", "<=": "≤"}


def verdicts_renderable(verdicts: Sequence[RequirementVerdict]) -> RenderableType:
    """Return verdicts for a rich console."""
    parts: list[RenderableType] = [Text("Requirements", style="bold")]
    for verdict in verdicts:
        head = Text.assemble((verdict.outcome.upper(), _STYLES[verdict.outcome]), f"  {title(verdict)}")
        parts += [head, Padding(Text(sentence(verdict)), (0, 0, 0, 2))]
        parts += [Padding(Text(note, style="dim"), (0, 0, 0, 2)) for note in notes(verdict)]
    return Group(*parts)


def title(verdict: RequirementVerdict) -> str:
    """Return requirement and function."""
    return f"{verdict.id} · {verdict.function}" + (f": {verdict.text}" if verdict.text else "")


def sentence(verdict: RequirementVerdict) -> str:
    """Return the measured value, the requirement, and what is missing for a decision."""
    where = f", where {verdict.where}," if verdict.where else ""
    estimate = "unknown" if verdict.estimate is None else f"{percent(verdict.estimate)} %"
    measured = f"The {_quantity(verdict)}{where} is {estimate}"
    if verdict.worst is not None and verdict.best is not None:
        low, high = sorted((verdict.worst, verdict.best))
        measured += f" ({percent(low)} to {percent(high)} % with the failed frames)"
    quantile = f": {verdict.statistic}" if verdict.statistic.lstrip().startswith("quantile") else ""
    text = f"{measured}; {_WORDS[verdict.sign]} {100 * verdict.bound:g} % is required{quantile}."
    if not verdict.reason:
        return text
    return f"{text} {verdict.reason[0].upper()}{verdict.reason[1:]}{_further(verdict)}."


def _quantity(verdict: RequirementVerdict) -> str:
    statistic = parse_statistic(verdict.statistic)
    if statistic.condition is None:
        return f"mean {statistic.measure.title}"
    comparison, threshold = statistic.condition
    return f"share of {verdict.of} with {statistic.measure.title} {_SIGNS[comparison]} {threshold:g}"


def _further(verdict: RequirementVerdict) -> str:
    if verdict.further is None:
        return ""
    if verdict.basis is Basis.GRID:
        return f": {verdict.further:,} {verdict.of}"
    return f": about {verdict.further:,} more{' in the region' if verdict.where else ''} would decide it"


def notes(verdict: RequirementVerdict) -> list[str]:
    """Return notes on the method, the rows left out, and the missed persons."""
    judged = f"{counted(verdict.rows, verdict.of.removesuffix('s'))} in {counted(verdict.units, 'variant')}"
    if verdict.basis is None:
        lines = [f"Not judged: {judged}."]
    else:
        after = "" if verdict.decided_after is None else f"; decided after {verdict.decided_after:,} variants"
        lines = [f"Of {verdict.basis}: {judged}; {verdict.method}{after}."]
    out = [f"{reasons_text(verdict.undefined)} (no value)"] if verdict.undefined else []
    out += [f"{verdict.too_small:,} with too few visible pixels"] if verdict.too_small else []
    out += [f"{verdict.lost:,} failed for good, counted at their worst"] if verdict.lost else []
    lines += [f"Not counted or not known: {'; '.join(out)}."] if out else []
    missed = [band for band in verdict.missed if band.missed]
    if missed:
        bands = ", ".join(f"{b.missed:,} of {b.persons:,} at {b.low:g}–{b.high:g} m" for b in missed)
        lines.append(f"Missed (pACC < {verdict.threshold:g}): {bands}.")
    return lines
