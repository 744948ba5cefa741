"""The summary in a terminal: a table of the paper's section 6.2 for people who do not want to leave the shell."""

from __future__ import annotations

from io import StringIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from valerie.analysis.findings import Findings
from valerie.analysis.frames import ALL
from valerie.analysis.intervals import Interval
from valerie.analysis.summary import OCCLUDED, Summary, SummaryRow

_DASH = "–"


def summary_renderable(summary: Summary, findings: Findings | None = None, *, most: int | None = 5) -> RenderableType:
    """The summary for a rich console; below it, where they are given, so many of the strongest findings (None: all)."""
    several = len({row.sensor for row in summary.rows}) > 1
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("pedestrian", no_wrap=True)
    for name in ("frames", "mean pACC", "min", "max", "pooled", f"≥ {summary.threshold:g}", "precision", "IoU"):
        table.add_column(name, justify="right")
    table.add_column("undefined")
    previous = None
    for row in summary.rows:
        who = row.function + (f" · {row.sensor}" if several else "")
        if previous != who:
            if previous is not None:
                table.add_section()
            table.add_row(Text(who, style="bold"))
        table.add_row(*(Text(cell) for cell in _cells(row)))
        previous = who
    parts: list[RenderableType] = [table if summary.rows else Text("No person was evaluated.")]
    parts += [Text(line, style="dim") for line in _notes(summary)]
    if findings is not None and findings.items:
        parts.append(Text("\nFindings", style="bold"))
        parts += [Text(f"{i}. {finding.sentence}") for i, finding in enumerate(findings.items[:most], 1)]
    return Group(*parts)


def summary_text(summary: Summary, findings: Findings | None = None, *, width: int = 140) -> str:
    """The same as plain text without colours, ``width`` characters wide."""
    sink = StringIO()
    Console(file=sink, width=width, color_system=None, force_terminal=False, highlight=False).print(
        summary_renderable(summary, findings)
    )
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines()).strip("\n") + "\n"


def _cells(row: SummaryRow) -> tuple[str, ...]:
    reasons = ", ".join(f"{count} {reason}" for reason, count in row.undefined.items()) or "none"
    return (
        "  " + ("all together" if row.character == ALL else row.character),
        f"{row.frames:,}",
        _percent(row.pacc_mean) + _within(row.pacc_mean_interval),
        _percent(row.pacc_min),
        _percent(row.pacc_max),
        _percent(row.pacc_pooled),
        _percent(row.detection_rate) + _within(row.detection_interval),
        f"{_percent(row.precision_mean)} / {_percent(row.precision_pooled)}",
        f"{_percent(row.iou_mean)} / {_percent(row.iou_pooled)}",
        reasons,
    )


def _notes(summary: Summary) -> list[str]:
    lines = ["In per cent; [95 % interval]; precision and IoU are of the frame: mean / from pooled counts."]
    shares = [
        f"{'all' if share.character == ALL else share.character} {_percent(share.share)} % of {share.persons:,}"
        for share in summary.occlusion
    ]
    if shares:
        lines.append(f"More than {100 * OCCLUDED:g} % occluded: {', '.join(shares)}.")
    lines += [
        f"{e.function}: {e.with_false_positives:,} of {e.frames:,} frames without a person have person pixels."
        for e in summary.empty
    ]
    return lines


def _percent(value: float | None) -> str:
    return _DASH if value is None else f"{100 * value:.1f}"


def _within(interval: Interval | None) -> str:
    return "" if interval is None else f" [{100 * interval.low:.0f}–{100 * interval.high:.0f}]"
