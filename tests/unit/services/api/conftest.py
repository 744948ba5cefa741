"""Fixtures of the API's tests: four drawn runs, made once per session, and servers over them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import structlog

from services.api.app import create_app
from tests.world.drawn import DrawnRuns, draw_runs
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.logs import configure_logging


@pytest.fixture(scope="session", autouse=True)
def _logs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Logs as the services write them: structlog's own tracebacks take seconds to draw."""
    configure_logging(settings_of(tmp_path_factory.mktemp("logs"), log_level="error"))
    yield
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> DrawnRuns:
    """Only to be read: tests that change something take `fresh`."""
    return draw_runs(settings_of(tmp_path_factory.mktemp("drawn") / "data"))


@pytest.fixture(scope="session")
def api(drawn: DrawnRuns) -> Iterator[httpx.Client]:
    """A server over the four runs, to be read."""
    with served(create_app(settings_of(drawn.folder), control=False)) as client:
        yield client


@pytest.fixture
def fresh(drawn: DrawnRuns, tmp_path: Path) -> Iterator[httpx.Client]:
    """A server over a copy of the four runs, to be changed."""
    shutil.copytree(drawn.folder, tmp_path / "data")
    with served(create_app(settings_of(tmp_path / "data"), control=False)) as client:
        yield client
