"""A few damaged specs; `make test-hostile` plans many more."""

from __future__ import annotations

import subprocess
import sys


def test_every_damaged_spec_is_planned_or_refused_in_words() -> None:
    # In a process of its own, whose memory is measured.
    command = [sys.executable, "-m", "tests.hostile", "--specs", "50"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
