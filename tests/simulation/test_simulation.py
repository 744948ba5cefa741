"""Seeded schedules of faults, and whether the simulation finds bugs. `make test-simulation` tries many more."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


def simulate(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the simulation in a process of its own, whose order of sets follows from the seed."""
    environment = {**os.environ, "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-m", "tests.simulation", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_no_schedule_of_faults_violates_an_invariant() -> None:
    done = simulate("--schedules", "12")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("bug", "fault"),
    [
        ("lost-lease", "kill worker"),
        ("double-publication", "freeze worker"),
        ("believed-clock", "clock back"),
        ("lost-message", "empty broker"),
    ],
)
def test_a_planted_bug_is_found(bug: str, fault: str) -> None:
    done = simulate("--bug", bug, "--fault", fault, "--schedules", "20", "--until-failure")
    assert (done.returncode, done.stderr) == (1, "")
    assert f"python -m tests.simulation --fault '{fault}' --bug {bug} --seed" in done.stdout
