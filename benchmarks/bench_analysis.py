"""Measure CPU time and memory of the analysis and the report of a large run.

``python -m benchmarks.bench_analysis [--frames 30720] [--no-report]``: a planted grid of two functions with an effect of the
sun, as large as the paper's experiment: 2 characters, 3 cameras, 10 × 16 places, 8 headings, 4 suns. ``--frames`` changes the
number of places. ``--kept`` analyses the rows of the kept run instead, which have measured columns, and writes the paper's
ledger, too. The report has no pictures of frames.
"""

from __future__ import annotations

import argparse
import resource
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import results
from benchmarks.planted import REPORTED
from benchmarks.planted_grids import planted_grid
from valerie.analysis.analyze import Analysis, analyze
from valerie.analysis.claims.ledger import write_ledger
from valerie.analysis.report.model import PictureSource, Provenance, ReportInput
from valerie.analysis.report.report import build_report
from valerie.analysis.rows.table import EvaluationTable
from valerie.cli.claims import read_claims

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "docs" / "experiment" / "paper-part.parquet"
CLAIMS = ROOT / "examples" / "claims" / "paper.yaml"
#: Numbers of places across, headings, suns, characters and cameras.
OTHERS = (10, 8, 4, 2, 3)


def paper_table(frames: int) -> EvaluationTable:
    """Return the table of two functions on about ``frames`` frames."""
    shape = (max(round(frames / np.prod(OTHERS)), 1), *OTHERS)
    y, x, heading, sun, character, camera = (axis.ravel() for axis in np.indices(shape))
    rng = np.random.default_rng(0)
    u = rng.random((2, len(x), 6))
    u[:, :, :3] = rng.random((shape[0], shape[1], 3))[y, x]
    u[:, :, 3] = rng.random((shape[0], shape[1], shape[3]))[y, x, sun]
    scores = REPORTED["mild"](u) - np.where(sun == 3, 0.1, 0.0)
    factors = {"x": x, "y": y, "heading": heading, "sun": sun, "character": character, "camera": camera}
    return planted_grid({"one": scores[0], "two": scores[1]}, factors)


def planted_report(
    table: EvaluationTable, analysis: Analysis | None = None, *, picture: PictureSource | None = None
) -> str:
    """Return the report of a planted run; without a source of pictures it shows no frames."""
    now, analysis = datetime.now(UTC), analysis or analyze(table)
    return build_report(
        ReportInput(
            document={"name": "planted"},
            provenance=Provenance("planted", "", 0, "planted", "", "none", (960, 540), {}, (), "valerie", now, now),
            table=table,
            summary=analysis.summary,
            trends=analysis.trends,
            findings=analysis.findings,
            variants=len(table) // 6,
            frames=len(table) // 2,
            picture=picture,
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30_720)
    parser.add_argument("--kept", action="store_true")
    parser.add_argument("--no-report", action="store_true")
    arguments = parser.parse_args()
    table = EvaluationTable.from_parquet(KEPT) if arguments.kept else paper_table(arguments.frames)
    figures: dict[str, Any] = {"rows": len(table), "places": int(table.places.max()) + 1}
    started = time.process_time()
    analysis = analyze(table)
    figures["analysis, CPU s"] = round(time.process_time() - started, 2)
    figures["comparisons"] = analysis.findings.comparisons
    figures["confirmed findings"] = len(analysis.findings.items)
    if arguments.kept:
        begun = time.process_time()
        write_ledger(read_claims(CLAIMS), table)
        figures["ledger, CPU s"] = round(time.process_time() - begun, 2)
    if not arguments.no_report:
        html = planted_report(table, analysis)
        figures["report, MB"] = round(len(html) / 1e6, 1)
    figures["all, CPU s"] = round(time.process_time() - started, 2)
    figures["peak memory, MB"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    for name, value in figures.items():
        print(f"{name}: {value:,}")
    results.write("analysis-kept" if arguments.kept else "analysis", figures)


if __name__ == "__main__":
    main()
