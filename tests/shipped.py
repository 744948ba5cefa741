"""The documents in ``examples/``."""

from pathlib import Path

import yaml

EXAMPLES = Path(__file__).parents[1] / "examples"
_FILES = sorted(EXAMPLES.glob("*.yaml"))
STUDIES = [file for file in _FILES if "goal" in yaml.safe_load(file.read_text("utf-8"))]
SPECS = [file for file in _FILES if file not in STUDIES]
