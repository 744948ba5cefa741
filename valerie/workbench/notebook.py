"""Runs and frames as notebooks show them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.findings.findings import Findings
from valerie.analysis.report.report import data_url
from valerie.analysis.summary.summary import Summary
from valerie.analysis.summary.text import summary_text
from valerie.answers import Progress
from valerie.measures import Cell, Row
from valerie.pipeline.reading.painting import jpeg

#: Width of a picture, pixels of the page.
_WIDTH: Final = 480


def run_html(run_id: str, name: str, progress: Progress, summary: Summary | None, findings: Findings | None) -> str:
    """Return a run: its name and state, and the table and findings of an ended one."""
    head = f"<p><b>{escape(name)}</b> <code>{escape(run_id)}</code> {escape(progress.state)}"
    head += f": {escape(progress.reason)}</p>" if progress.reason else "</p>"
    if summary is None:
        stages = "".join(f"<li>{escape(stage)}: {n.done:,} of {n.total:,}</li>" for stage, n in progress.stages.items())
        return f"{head}<ul>{stages}</ul>"
    warnings = "".join(f"<p><b>Warning: {escape(text)}</b></p>" for text in summary.warnings)
    return f'{head}{warnings}<pre style="overflow-x: auto">{escape(summary_text(summary, findings))}</pre>'


def frame_html(frame_id: str, sensor: str, picture: NDArray[np.uint8], rows: Sequence[Row]) -> str:
    """Return a frame: its picture, and the scores of the persons in its rows."""
    cells = "".join(
        f"<tr><td>{escape(str(row['function']))}</td><td>{row['instance_id'] or ''}</td>"
        f"<td>{_number(row['distance_m'], 1)}</td><td>{_number(row['pacc'], 3)}</td></tr>"
        for row in rows
    )
    return (
        f'<figure><img width="{_WIDTH}" alt="Picture of the frame" src="{data_url(jpeg(picture))}">'
        f"<figcaption><code>{escape(frame_id)}</code>, sensor {escape(sensor)}</figcaption></figure>"
        "<table><thead><tr><th>function</th><th>person</th><th>distance (m)</th><th>pACC</th></tr></thead>"
        f"<tbody>{cells}</tbody></table>"
    )


def _number(value: Cell, digits: int) -> str:
    return "" if value is None else f"{float(value):.{digits}f}"
