from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from valerie.rendering.cycles.blender import BlenderHolder
from valerie.settings import load_settings

FAKE = Path(__file__).with_name("fake_blender.py")


@pytest.fixture
def fake_python(tmp_path: Path) -> Callable[[str], Path]:
    """An interpreter that runs a fake Blender, whatever program it is given."""

    def make(behaviour: str) -> Path:
        path = tmp_path / "python"
        path.write_text(f'#!/bin/sh\nexec {sys.executable} {FAKE} "{behaviour}" "$@"\n')
        path.chmod(0o755)
        return path

    return make


@pytest.fixture
def holder(fake_python: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    """Makes holders of fake Blenders."""
    made: list[BlenderHolder] = []
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def make(behaviour: str, **settings: object) -> BlenderHolder:
        found = load_settings({}, cycles_python=fake_python(behaviour), cycles_silence_seconds=1.0)
        made.append(BlenderHolder(found.model_copy(update=settings)))
        return made[-1]

    yield make
    for one in made:
        one.close()
