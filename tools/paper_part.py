"""Run examples/paper-part.yaml and keep its report and rows: ``make paper-part`` renews ``docs/experiment/``.

Finished products are reused, so that an interrupted command continues where it stopped.
"""

from __future__ import annotations

import json
import lzma
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "docs" / "experiment"


def main() -> None:
    """Run the experiment and write ``paper-part.html.xz`` and ``paper-part.parquet``."""
    valerie = (sys.executable, "-m", "valerie")
    page = ROOT / "var" / "paper-part.html"
    claims = ROOT / "examples" / "claims" / "paper.yaml"
    spec = ROOT / "examples" / "paper-part.yaml"
    run = (*valerie, "run", str(spec), "--claims", str(claims), "--report", str(page), "--json")
    with subprocess.Popen(run, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        started = json.loads(process.stdout.readline())
        for line in process.stdout:
            sys.stdout.write(line)
    if process.returncode:
        raise SystemExit(process.returncode)
    KEPT.mkdir(exist_ok=True)
    (KEPT / "paper-part.html.xz").write_bytes(lzma.compress(page.read_bytes(), preset=9))
    rows = (*valerie, "rows", started["run"], "-o", str(KEPT / "paper-part.parquet"))
    raise SystemExit(subprocess.run(rows, check=False).returncode)


if __name__ == "__main__":
    main()
