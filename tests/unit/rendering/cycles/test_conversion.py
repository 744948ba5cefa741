"""Conversion without Blender: files that are refused before it starts, and a fake Blender that misbehaves."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from valerie.errors import InvalidInput, MissingDependency, RenderingError
from valerie.rendering.cycles.conversion import convert_blend
from valerie.settings import Settings, load_settings

CRASH = "import os; print('Segmentation fault', flush=True); os.abort()"
HANG = "import time; time.sleep(60)"
GREEDY = "import time; held = bytearray(600_000_000); time.sleep(60)"
REFUSE = "import json, sys; json.dump({'error': 'RuntimeError: not a library'}, open(sys.argv[-1], 'w'))"
WORK = """
import json, sys
open(sys.argv[-2], "wb").write(b"glTF")
json.dump({"version": "9.9.9", "notes": ["material paint: baked"]}, open(sys.argv[-1], "w"))
"""


@pytest.fixture
def blend(tmp_path: Path) -> Path:
    path = tmp_path / "street.blend"
    path.write_bytes(b"BLENDER-v405 and so on")
    return path


def pretending(tmp_path: Path, program: str) -> Settings:
    """Return settings with an interpreter that runs ``program`` instead of its own."""
    script, python = tmp_path / "program.py", tmp_path / "python"
    script.write_text(program)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} {script} "$@"\n')
    python.chmod(0o755)
    return load_settings({}, cycles_python=python, cycles_max_memory_mb=512)


def test_blenders_output_is_written_with_its_notes(blend: Path, tmp_path: Path) -> None:
    conversion = convert_blend(blend, tmp_path / "street.glb", pretending(tmp_path, WORK))
    assert conversion.path.read_bytes() == b"glTF"
    assert (conversion.version, conversion.notes) == ("9.9.9", ("material paint: baked",))


def test_another_kind_of_file_is_refused_before_blender_starts(tmp_path: Path) -> None:
    (tmp_path / "street.blend").write_bytes(b"glTF\2\0\0\0")
    with pytest.raises(InvalidInput, match=r"not a \.blend file"):
        convert_blend(tmp_path / "street.blend", tmp_path / "street.glb", load_settings({}, cycles_python="/nowhere"))


def test_a_file_that_is_not_there_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="No such file"):
        convert_blend(tmp_path / "street.blend", tmp_path / "street.glb", load_settings({}))


def test_without_blender_the_error_says_how_to_get_it(blend: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingDependency, match="make cycles"):
        convert_blend(blend, tmp_path / "street.glb", load_settings({}, cycles_python="/nowhere"))


def test_a_crash_gives_blenders_last_words(blend: Path, tmp_path: Path) -> None:
    with pytest.raises(RenderingError, match=r"ended while it converted street\.blend: Segmentation fault"):
        convert_blend(blend, tmp_path / "street.glb", pretending(tmp_path, CRASH))


def test_a_file_that_blender_refuses_is_an_invalid_input(blend: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="not a library"):
        convert_blend(blend, tmp_path / "street.glb", pretending(tmp_path, REFUSE))


def test_a_hang_is_ended(blend: Path, tmp_path: Path) -> None:
    with pytest.raises(RenderingError, match=r"did not finish within 0\.5 s"):
        convert_blend(blend, tmp_path / "street.glb", pretending(tmp_path, HANG), seconds=0.5)


def test_a_file_that_takes_too_much_memory_is_ended(blend: Path, tmp_path: Path) -> None:
    with pytest.raises(RenderingError, match="VALERIE_CYCLES_MAX_MEMORY_MB is 512"):
        convert_blend(blend, tmp_path / "street.glb", pretending(tmp_path, GREEDY))
