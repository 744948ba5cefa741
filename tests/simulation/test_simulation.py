"""Seeded schedules of faults, and planted bugs that they must find. `make test-simulation` tries many more."""

from __future__ import annotations

import subprocess
import sys

import pytest


def run(*arguments: str) -> None:
    # In a process of its own with a fixed order of sets, so that failures are reproducible.
    command = [sys.executable, "-m", "tests.simulation", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.timeout(900)
def test_no_schedule_violates_an_invariant_and_every_planted_bug_is_found() -> None:
    run("--schedules", "100", "--processes", "2", "--prove")


def test_small_runs_render_again_soon_after_an_outage() -> None:
    run("--outage", "--schedules", "10")
