from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.cycles_parts import Parts
from valerie.errors import InvalidInput

SETUP = {"width": 96, "revision": 3}


def test_a_part_is_there_after_a_restart(tmp_path: Path) -> None:
    pixels = np.arange(6, dtype=np.float32).reshape(2, 3)
    Parts(tmp_path, SETUP).add("4/window/64/0", {"noisy": pixels}, cpu_s=1.5)
    again = Parts(tmp_path, SETUP)
    assert "4/window/64/0" in again
    assert again.figures("4/window/64/0") == {"key": "4/window/64/0", "cpu_s": 1.5}
    np.testing.assert_array_equal(again.arrays("4/window/64/0")["noisy"], pixels)


def test_a_line_that_a_crash_cut_off_counts_for_nothing(tmp_path: Path) -> None:
    parts = Parts(tmp_path, SETUP)
    parts.add("first", {}, cpu_s=1.0)
    parts.add("second", {}, cpu_s=2.0)
    lines = tmp_path / "parts.jsonl"
    lines.write_text(lines.read_text()[:-5])
    again = Parts(tmp_path, SETUP)
    assert "first" in again
    assert "second" not in again


def test_a_part_that_is_made_again_after_a_crash_is_found_behind_the_broken_line(tmp_path: Path) -> None:
    Parts(tmp_path, SETUP).add("first", {}, cpu_s=1.0)
    lines = tmp_path / "parts.jsonl"
    lines.write_text(lines.read_text()[:-5])
    Parts(tmp_path, SETUP).add("first", {}, cpu_s=3.0)
    assert Parts(tmp_path, SETUP).figures("first")["cpu_s"] == 3.0


def test_parts_of_another_setup_are_refused_by_name_and_both_values(tmp_path: Path) -> None:
    Parts(tmp_path, SETUP)
    with pytest.raises(InvalidInput, match=r"revision 3, not 4"):
        Parts(tmp_path, {**SETUP, "revision": 4})
