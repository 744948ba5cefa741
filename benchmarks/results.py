"""Store the figures of a benchmark as ``var/bench/NAME.json``."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path
from typing import Any


def write(name: str, figures: dict[str, Any]) -> None:
    """Write the figures, with a description of the machine."""
    folder = Path("var/bench")
    folder.mkdir(parents=True, exist_ok=True)
    machine = {"cpus": os.cpu_count(), "load": os.getloadavg()[0], "python": platform.python_version()}
    path = folder / f"{name}.json"
    path.write_text(json.dumps({"machine": machine, **figures}, indent=2) + "\n")
    print(f"written: {path}")
