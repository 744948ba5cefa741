"""All statistics of a finished run: summary, trends and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from valerie.analysis.findings.findings import Findings
from valerie.analysis.findings.search import find_findings
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.all_classes import AllClasses
from valerie.analysis.summary.summary import Summary, summarize
from valerie.analysis.trends.trends import Trends, find_trends
from valerie.runs.document.run_spec import RunSpec


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
    spec: RunSpec | None = None,
) -> Analysis:
    """Return summary, trends and findings of a run; equal input gives equal numbers.

    Args:
        table: the run's evaluations.
        classes: their scores over all classes, for the summary.
        precisions: function to the precision that it ran in; see `valerie.analysis.findings.search.incomparable`.
        threshold: detection threshold t, 0 < t ≤ 1.
        seed: of all random choices: places that search, folds, bands.
        spec: of the run; if present, each finding proposes a run that examines it.

    Raises:
        InvalidInput: the threshold is out of bounds.
    """
    return Analysis(
        summarize(table, classes=classes, threshold=threshold),
        find_trends(table, seed=seed, threshold=threshold),
        find_findings(table, seed=seed, precisions=precisions, spec=spec),
    )
