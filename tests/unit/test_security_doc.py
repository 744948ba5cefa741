"""The threat model names tests that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_threat_has_a_test_that_exists() -> None:
    threats = (ROOT / "docs" / "security.md").read_text("utf-8").partition("## Threats\n")[2].partition("\n## ")[0]
    rows = [row for row in threats.splitlines() if row.startswith("| ")][1:]
    assert rows
    for row in rows:
        named = re.search(r"\| `(tests/[\w/]+\.py)::(\w+)` \|$", row)
        assert named is not None, f"no test: {row}"
        path, test = named.groups()
        module = ast.parse((ROOT / path).read_text("utf-8"))
        assert test in {node.name for node in module.body if isinstance(node, ast.FunctionDef)}, f"{path} lacks {test}"
