"""Run a part of the paper's experiment and keep its results in ``docs/experiment/``.

``make paper-part``, ``paper-streets``, ``paper-light`` and ``paper-cycles`` call this. What stays the same is not made again,
so an interrupted command goes on where it stopped.
"""

from __future__ import annotations

import json
import lzma
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
import yaml
from PIL import Image

from tools.contact_sheet import captioned, contact_sheet
from valerie.analysis.comparison.beside import Beside, ComparedRun, put_beside
from valerie.analysis.comparison.wording import difference_of_specs
from valerie.analysis.findings.search import find_findings
from valerie.analysis.report.panels import make_panel
from valerie.analysis.report.plots import static_figure
from valerie.analysis.rows.frame_counts import settings
from valerie.analysis.rows.pairing import frames_of_any_run
from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.trends.trends import find_trends
from valerie.analysis.wording import setting_labels
from valerie.cli.claims import read_claims
from valerie.measures import measure_of
from valerie.runs.products.frame_keys import FrameKey

ROOT: Final = Path(__file__).parents[1]
KEPT: Final = ROOT / "docs" / "experiment"
CLAIMS: Final = str(ROOT / "examples" / "claims" / "paper.yaml")
SPECS: Final = ROOT / "examples"
#: Site seeds; no shipped network is trained on these sites.
_STREETS: Final = range(10)
#: Reports, and specs that are made here.
MADE: Final = ROOT / "var"


def keep_part() -> None:
    """Run two of eight headings at full size; keep the rows. The report stays in ``var/``."""
    _keep_rows(_run(SPECS / "paper-part.yaml"), "paper-part")


def keep_streets() -> None:
    """Repeat a part on ten streets; keep all rows and one report, with the kept comparison of engines on its first page."""
    runs = [
        _run(_made("paper-streets", f"paper-streets-{seed}", asset={"name": "urban-street", "seed": seed}))
        for seed in _STREETS
    ]
    tables = []
    for run in runs:
        rows = MADE / f"{run}.parquet"
        _valerie("rows", run, "-o", str(rows))
        tables.append(EvaluationTable.from_parquet(rows))
    EvaluationTable.joined(tables).to_parquet(KEPT / "paper-streets.parquet")
    page = MADE / "paper-streets.html"
    _valerie("report", *runs, "--claims", CLAIMS, "--beside", str(KEPT / "paper-cycles.json"), "-o", str(page))
    (KEPT / "paper-streets.html.xz").write_bytes(lzma.compress(page.read_bytes(), preset=9))


def keep_light() -> None:
    """Run a part with the light on each person; keep the rows and pACC over light as a picture. The report stays in ``var/``."""
    _keep_rows(_run(SPECS / "paper-light.yaml"), "paper-light")
    draw_light(KEPT / "paper-light.parquet", ROOT / "docs" / "images" / "paper-light.png")


def draw_light(rows: Path, picture: Path) -> None:
    """Draw pACC over irradiance, shadow and contrast, a column per function."""
    table = EvaluationTable.from_parquet(rows)
    trends = find_trends(table, seed=0, axes=[measure_of(name) for name in ("irradiance", "shadow_share", "contrast")])
    tiles = []
    for axis in dict.fromkeys(trend.column for trend in trends.items):
        for (function, sensor), title in setting_labels(settings(table)).items():
            panel = make_panel(table, trends, axis, function, sensor, seed=0)
            drawn = (
                Image.open(BytesIO(static_figure(panel))).convert("RGB").resize((640, 380), Image.Resampling.LANCZOS)
            )
            tiles.append(captioned(drawn, drawn.size, f"{title}, {panel.total:,} persons"))
    contact_sheet(tiles, columns=2).quantize(64).save(picture, optimize=True)


def keep_cycles() -> None:
    """Run a part by both engines; keep the rows of both, and what holds in both. The report stays in ``var/``."""
    raster_spec = _made("paper-cycles", "paper-cycles-raster", renderer="raster")
    raster = _run(raster_spec)
    cycles = _run(SPECS / "paper-cycles.yaml")
    _keep_rows(raster, "paper-cycles-raster")
    _keep_rows(cycles, "paper-cycles")
    (KEPT / "paper-cycles.json").write_text(json.dumps(compare_kept().to_json(), ensure_ascii=False))
    _valerie("report", raster, "--claims", CLAIMS, "--beside", cycles, "-o", str(MADE / "paper-cycles.html"))


def compare_kept() -> Beside:
    """Compare the kept rows of both engines, with the paper's claims and the findings by raster."""
    spec = yaml.safe_load((SPECS / "paper-cycles.yaml").read_text())
    sides = []
    for engine, name in (("raster", "paper-cycles-raster"), ("cycles", "paper-cycles")):
        table = EvaluationTable.from_parquet(KEPT / f"{name}.parquet")
        run_id = FrameKey.parse(table.codes("frame_id").names[0]).run_id
        scenes = np.array(
            [f"{frame.variant}.{frame.camera}.{frame.time}" for frame in frames_of_any_run(table)], object
        )
        sides.append(ComparedRun(f"{name} ({engine})", run_id, table, scenes))
    findings = find_findings(sides[0].table, seed=spec.get("seed", 0))
    return put_beside(
        *sides,
        findings=[*findings.items, *findings.candidates],
        claims=read_claims(Path(CLAIMS)),
        differs=[difference_of_specs("renderer", "raster", spec["renderer"])],
    )


def _made(example: str, name: str, **fields: object) -> Path:
    """Write an example's spec with another name and other fields, and return its path."""
    MADE.mkdir(exist_ok=True)
    spec = yaml.safe_load((SPECS / f"{example}.yaml").read_text())
    path = MADE / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**spec, "name": name, **fields}, sort_keys=False))
    return path


def _run(spec: Path) -> str:
    """Run a spec with the paper's claims, write its report to ``var/``, and return the run's id."""
    page = MADE / f"{spec.stem}.html"
    command = (*_VALERIE, "run", str(spec), "--claims", CLAIMS, "--report", str(page), "--json")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())
        for line in process.stdout:
            sys.stdout.write(line)
    if process.returncode:
        raise SystemExit(process.returncode)
    return str(started["run"])


def _keep_rows(run: str, name: str) -> None:
    KEPT.mkdir(exist_ok=True)
    _valerie("rows", run, "-o", str(KEPT / f"{name}.parquet"))


def _valerie(*words: str) -> None:
    status = subprocess.run((*_VALERIE, *words), check=False).returncode
    if status:
        raise SystemExit(status)


_VALERIE: Final = (sys.executable, "-m", "valerie")
_PARTS: Final = {"part": keep_part, "streets": keep_streets, "light": keep_light, "cycles": keep_cycles}

if __name__ == "__main__":
    _PARTS[sys.argv[1]]()
