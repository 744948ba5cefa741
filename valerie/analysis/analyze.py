"""All statistics of a finished run: summary, trends and findings from the same bootstrap draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from valerie.analysis.all_classes import AllClasses
from valerie.analysis.findings import Findings, find_findings
from valerie.analysis.intervals import Resampler
from valerie.analysis.summary import Summary, summarize
from valerie.analysis.table import EvaluationTable
from valerie.analysis.trends import Trends, find_trends


@dataclass(frozen=True, slots=True)
class Analysis:
    """Statistics of one run."""

    summary: Summary
    trends: Trends
    findings: Findings


def analyze(
    table: EvaluationTable,
    *,
    classes: Sequence[AllClasses] = (),
    precisions: Mapping[str, str] | None = None,
    threshold: float = 0.5,
    seed: int = 0,
    resamples: int = 2000,
) -> Analysis:
    """Return summary, trends and findings of a run; equal input gives equal numbers.

    Args:
        table: the run's evaluations.
        classes: their scores over all classes, for the summary.
        precisions: function to the precision that it ran in; see `valerie.analysis.comparisons.incomparable`.
        threshold: detection threshold t, 0 < t ≤ 1.
        seed: of the bootstrap draws and the cross-validation folds.
        resamples: number of bootstrap draws.

    Raises:
        InvalidInput: the threshold is out of bounds.
    """
    resampler = Resampler(table.situations, seed=seed, resamples=resamples)
    summary = summarize(table, classes=classes, threshold=threshold, resampler=resampler)
    trends = find_trends(table, resampler=resampler, seed=seed, threshold=threshold)
    return Analysis(summary, trends, find_findings(table, trends, resampler=resampler, precisions=precisions))
