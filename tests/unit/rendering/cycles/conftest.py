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
    """Return a function that writes an interpreter, which runs a fake Blender instead of its program."""

    def make(behaviour: str) -> Path:
        path = tmp_path / "python"
        path.write_text(f'#!/bin/sh\nexec {sys.executable} {FAKE} "{behaviour}" "$@"\n')
        path.chmod(0o755)
        return path

    return make


@pytest.fixture
def holder(fake_python: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    """Return a function that creates holders of fake Blenders, and close them after the test."""
    holders: list[BlenderHolder] = []
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def make(behaviour: str, **settings: object) -> BlenderHolder:
        defaults = load_settings({}, cycles_python=fake_python(behaviour), cycles_silence_seconds=1.0)
        holders.append(BlenderHolder(defaults.model_copy(update=settings)))
        return holders[-1]

    yield make
    for fake in holders:
        fake.close()
