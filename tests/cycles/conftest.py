"""Tests with a real Blender: `make test-cycles`, which installs it. Small images, few samples."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from valerie.rendering.cycles.blender import BlenderHolder, interpreter
from valerie.settings import Settings, load_settings


@pytest.fixture(scope="session")
def deployment() -> Settings:
    """Return settings with the environment of `make cycles`, or the one that VALERIE_TEST_CYCLES_PYTHON names."""
    settings = load_settings({}, cycles_python=os.environ.get("VALERIE_TEST_CYCLES_PYTHON"), cycles_device="cpu")
    interpreter(settings)
    return settings


@pytest.fixture(scope="session")
def holder(deployment: Settings) -> Iterator[BlenderHolder]:
    blenders = BlenderHolder(deployment)
    yield blenders
    blenders.close()
