"""Seeded schedules of faults, and whether the simulation finds bugs. `make test-simulation` tries many more."""

from __future__ import annotations

import subprocess
import sys


def test_no_schedule_violates_an_invariant_and_every_planted_bug_is_found() -> None:
    # A process of its own, whose order of sets follows from the seed: what fails here fails again.
    command = [sys.executable, "-m", "tests.simulation", "--schedules", "12", "--prove"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
