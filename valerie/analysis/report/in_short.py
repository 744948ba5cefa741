"""Summary of a report in a few sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from valerie.analysis.comparison.beside import Beside
from valerie.analysis.comparison.wording import span_text
from valerie.analysis.report.model import ReportInput
from valerie.analysis.report.seeing import Seeing
from valerie.analysis.rows.frame_counts import ALL
from valerie.analysis.verdicts.verdicts import RequirementVerdict
from valerie.analysis.wording import percent, place_noun, points, setting_labels
from valerie.statistics.units import Estimand
from valerie.statistics.verdicts import Outcome


def in_short(source: ReportInput, seen: Sequence[Seeing]) -> list[str]:
    """Return a sentence each about verdicts, scores, findings, claims, the other run, and what none of them covers."""
    summary = source.summary
    labels = setting_labels((row.function, row.sensor) for row in summary.rows)
    together = [row for row in summary.rows if row.character == ALL] or list(summary.rows)
    seen_together = [row for row in seen if row.character == ALL] or list(seen)
    findings = len(source.findings.items)
    sentences = [_requirements(source.verdicts)]
    sentences += [
        f"{labels[row.function, row.sensor]} sees {percent(row.pacc_mean)} % of a person's visible pixels on average, and "
        f"misses {row.defined - row.detected:,} of {row.defined:,} persons (pACC < {summary.threshold:g})."
        for row in together
        if row.defined
    ]
    sentences += [
        f"Where nobody stands, {labels[row.function, row.sensor]} calls {percent(row.pacc_empty)} % of the same pixels person: "
        f"{row.lucky:,} of its {row.detected:,} detections would count without the person, too."
        for row in seen_together
    ]
    if findings:
        are, places = "finding is" if findings == 1 else "findings are", place_noun(source.findings.items[0].estimand)
        sentences.append(f"{findings:,} {are} confirmed by {places} that had no part in the search.")
    elif source.findings.comparisons:
        sentences.append("No finding is confirmed.")
    sentences.append(_counted("Claims", [str(entry.outcome) for entry in source.ledger]))
    if source.beside is not None:
        for function in source.beside.functions:
            whole, rank = function.slices[0], function.rank_correlation
            sentences.append(
                f"{function.title}: in {source.beside.there}, pACC differs by {points(whole.difference.mean)} points from "
                f"{source.beside.here}{span_text(whole.difference)}, on {whole.pairs:,} equal views"
                f"{'' if rank is None else f', rank correlation {rank:.2f}'}."
            )
        sentences += _conclusions(source.beside)
    listed = any(
        row.pacc_mean_interval is not None and row.pacc_mean_interval.estimand is Estimand.LISTED_GRID
        for row in summary.rows
    )
    beyond = (
        "values between the listed ones, other sites or real pictures" if listed else "other scenes or real pictures"
    )
    sentences.append(f"Not claimed: anything about {beyond}.")
    return [sentence for sentence in sentences if sentence]


def _requirements(verdicts: Sequence[RequirementVerdict]) -> str:
    """Return the number of each verdict, and which requirements are not met or undecided."""
    by_outcome: dict[Outcome, list[str]] = {outcome: [] for outcome in Outcome}
    for verdict in verdicts:
        by_outcome[verdict.outcome].append(f"{verdict.id} by {verdict.function}")
    counts = [
        f"{len(names):,} {outcome}" + ("" if outcome is Outcome.MET else f" ({', '.join(names)})")
        for outcome, names in by_outcome.items()
        if names
    ]
    return f"Requirements: {'; '.join(counts)}." if counts else ""


def _conclusions(beside: Beside) -> Iterator[str]:
    """Yield which conclusions hold in both runs, in neither or in one, and how many are undecided."""
    agreements: dict[tuple[str, bool], dict[str, list[str]]] = {}
    for conclusion in beside.conclusions:
        texts = agreements.setdefault((conclusion.agreement, conclusion.decided), {})
        texts.setdefault(conclusion.text.rstrip("."), []).append(conclusion.here.function)
    for (agreement, decided), texts in sorted(agreements.items()):
        if decided:
            said = "; ".join(f"{text} ({', '.join(functions)})" for text, functions in texts.items())
        else:
            said = f"{sum(map(len, texts.values())):,} of {len(beside.conclusions):,} conclusions"
        yield f"{agreement.capitalize()}: {said}."


def _counted(what: str, answers: Sequence[str]) -> str:
    """Return the number of each answer as a sentence; empty without answers."""
    counts = Counter(answers)
    return f"{what}: {', '.join(f'{answer} {count}' for answer, count in counts.items())}." if counts else ""
