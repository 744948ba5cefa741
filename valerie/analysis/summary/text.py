"""The summary as a table in a terminal."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from io import StringIO
from typing import Final

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.table import Table
from rich.text import Text

from valerie.analysis.findings.findings import Findings
from valerie.analysis.findings.wording import candidate_text, searched_sentence
from valerie.analysis.summary.summary import Spread, Summary, SummaryRow
from valerie.analysis.summary.wording import certainty_sentences, occlusion_sentence
from valerie.analysis.wording import classes_text, pedestrian, percent, reasons_text, setting_labels
from valerie.statistics.intervals import Interval, Refusal

#: Column of `_cells` to its title; {} is the threshold.
_COLUMNS: Final = {
    "frames": "frames",
    "mean pACC": "mean pACC",
    "min": "min",
    "max": "max",
    "pooled": "pooled",
    "detected": "≥ {}",
    "precision": "precision",
    "IoU": "IoU",
    "undefined": "undefined",
}
#: The same columns in two tables that fit into 80 characters.
_SCORES: Final = {name: _COLUMNS[name] for name in ("frames", "mean pACC", "min", "max", "precision", "IoU")}
_BESIDE: Final = {"pooled": "pooled pACC", "detected": "pACC ≥ {}", "undefined": "undefined"}
_ANY_WIDTH: Final = 10_000


def summary_renderable(summary: Summary, findings: Findings | None = None, *, most: int | None = 5) -> RenderableType:
    """Return the summary for a rich console, followed by the strongest findings.

    Args:
        summary: summary of the run.
        findings: findings of the run; None: only the summary.
        most: largest number of findings, and of candidates; None: all.
    """
    parts: list[RenderableType] = [_Rows(summary) if summary.rows else Text("No person was evaluated.")]
    parts += [Text(line, style="dim") for line in _notes(summary)]
    if findings is not None:
        parts += _findings(findings, most)
    return Group(*parts)


def warnings_renderable(summary: Summary) -> RenderableType:
    """Return the warnings of a summary for a rich console, one paragraph each."""
    return Group(*(Text(f"Warning: {sentence}\n", style="bold red") for sentence in summary.warnings))


def summary_text(summary: Summary, findings: Findings | None = None, *, width: int = 140) -> str:
    """Return summary and findings as plain text without colours, ``width`` characters wide."""
    sink = StringIO()
    Console(file=sink, width=width, color_system=None, force_terminal=False, highlight=False).print(
        summary_renderable(summary, findings)
    )
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines()).strip("\n") + "\n"


def _findings(findings: Findings, most: int | None) -> list[RenderableType]:
    parts: list[RenderableType] = [Text("\nFindings", style="bold")]
    parts += [Text(f"{i}. {finding.sentence}") for i, finding in enumerate(findings.items[:most], 1)]
    parts.append(Text(searched_sentence(findings), style="dim"))
    if findings.candidates:
        parts.append(Text("\nCandidates, not confirmed", style="bold"))
        parts += [
            Text(f"{i}. {candidate.sentence} {candidate_text(candidate)}")
            for i, candidate in enumerate(findings.candidates[:most], len(findings.items) + 1)
        ]
    return parts + [Text(note, style="dim") for note in findings.notes]


class _Rows:
    """The rows in one table, or in two on a narrow screen, so that no number is cut off."""

    def __init__(self, summary: Summary) -> None:
        self._summary = summary

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        whole = self._table(_COLUMNS)
        if console.measure(whole, options=options.update(max_width=_ANY_WIDTH)).maximum <= options.max_width:
            yield whole
        else:
            yield from (self._table(_SCORES), "", self._table(_BESIDE))

    def _table(self, columns: Mapping[str, str]) -> Table:
        """Return a table with ``columns`` of all rows, grouped by function."""
        summary = self._summary
        labels = setting_labels((row.function, row.sensor) for row in summary.rows)
        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
        table.add_column("pedestrian")
        for name, title in columns.items():
            is_text = name == "undefined"
            table.add_column(
                title.format(f"{summary.threshold:g}"), justify="left" if is_text else "right", no_wrap=not is_text
            )
        previous = None
        for row in summary.rows:
            title = labels[row.function, row.sensor]
            if previous != title:
                if previous is not None:
                    table.add_section()
                table.add_row(Text(title, style="bold"))
            cells = _cells(row)
            table.add_row(Text(f"  {pedestrian(row.character)}"), *(Text(cells[name]) for name in columns))
            previous = title
        return table


def _cells(row: SummaryRow) -> dict[str, str]:
    """Return the text of each column."""
    return {
        "frames": f"{row.frames:,}",
        "mean pACC": percent(row.pacc_mean) + _within(row.pacc_mean_interval, row.pacc_mean_spread),
        "min": percent(row.pacc_min),
        "max": percent(row.pacc_max),
        "pooled": percent(row.pacc_pooled),
        "detected": percent(row.detection_rate) + _within(row.detection_interval, row.detection_spread),
        "precision": f"{percent(row.precision_mean)} / {percent(row.precision_pooled)}",
        "IoU": f"{percent(row.iou_mean)} / {percent(row.iou_pooled)}",
        "undefined": reasons_text(row.undefined),
    }


def _notes(summary: Summary) -> list[str]:
    lines = ["In per cent; precision and IoU are of the frame: mean / from pooled counts."]
    lines += certainty_sentences(summary)
    lines += [sentence] if (sentence := occlusion_sentence(summary.occlusion)) else []
    lines += [
        f"{empty.function}: {empty.with_false_positives:,} of {empty.frames:,} frames without a person have person pixels."
        for empty in summary.empty
    ]
    labels = setting_labels((scores.function, scores.sensor) for scores in summary.classes)
    mious: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for scores in summary.classes:
        text = f"{labels[scores.function, scores.sensor]} {percent(scores.miou_mean)} / {percent(scores.miou_pooled)}"
        mious[scores.judged_by].append(text)
    lines += [
        f"Mean IoU of {classes_text(judged_by)}, frame mean / pooled: {', '.join(texts)}."
        for judged_by, texts in mious.items()
    ]
    return lines


def _within(interval: Interval | Refusal | None, spread: Spread | None) -> str:
    ends = interval if isinstance(interval, Interval) else spread
    return "" if ends is None else f" [{100 * ends.low:.0f}–{100 * ends.high:.0f}]"
