"""Logs of a process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import logging, structlog
from valerie.logs import configure_logging
from valerie.settings import load_settings

configure_logging(load_settings({}))
try:
    raise ValueError("no")
except ValueError:
    structlog.get_logger().exception("failed")
structlog.get_logger().warning("waits")
logging.getLogger("other").warning("waits")
print("goes on")
"""


@pytest.mark.parametrize("target", ["/dev/full", "log"])
def test_a_full_disk_takes_no_process_its_logs_lead_to(target: str, tmp_path: Path) -> None:
    with (tmp_path / target).open("w") as log:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=log, text=True, check=False
        )
    assert done.stdout == "goes on\n"
    if target == "log":
        text = (tmp_path / target).read_text("utf-8")
        assert text.count("waits") == 2
        assert "ValueError: no" in text
