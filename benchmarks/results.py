"""Store the figures of a benchmark as ``var/bench/NAME.json``."""

from __future__ import annotations

import csv
import json
import os
import platform
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from valerie.plain import JsonObject


def print_rows(rows: Iterable[JsonObject]) -> list[JsonObject]:
    """Print each row as soon as it is there, then the CPU seconds that all took; return the rows."""
    started = time.process_time()
    printed: list[JsonObject] = []
    for row in rows:
        printed.append(row)
        print("  " + ", ".join(f"{key} {_text(value)}" for key, value in row.items()), flush=True)
    print(f"  {time.process_time() - started:.0f} CPU seconds", flush=True)
    return printed


def write(name: str, figures: dict[str, Any]) -> None:
    """Write the figures, with a description of the machine."""
    folder = Path("var/bench")
    folder.mkdir(parents=True, exist_ok=True)
    machine = {"cpus": os.cpu_count(), "load": os.getloadavg()[0], "python": platform.python_version()}
    path = folder / f"{name}.json"
    path.write_text(json.dumps({"machine": machine, **figures}, indent=2) + "\n")
    print(f"written: {path}")


def write_table(name: str, rows: Sequence[JsonObject]) -> None:
    """Write rows of equal columns as ``var/bench/NAME.csv``, figures with four digits."""
    path = Path("var/bench") / f"{name}.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)
    print(f"written: {path}")


def _text(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
