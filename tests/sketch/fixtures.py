"""Fixtures of the API's tests: four drawn runs, made once per session, and servers over them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
import structlog
from sketch.runs import open_sketch, settings_of, spec, work
from sketch.serving import served

from services.api.app import create_app
from valerie.logs import configure_logging


@dataclass(frozen=True)
class Sketch:
    """A deployment's folder and the runs in it, oldest first.

    Attributes:
        finished: every product is done; some variants are rejected, some persons undefined.
        failed: completed with failures: the layer of variant 4 is broken in each camera.
        running: some products are done.
        waiting: submitted; no worker offers its engine.
    """

    folder: Path
    finished: str
    failed: str
    running: str
    waiting: str


@pytest.fixture(scope="session", autouse=True)
def _logs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Logs as the services write them: structlog's own tracebacks take seconds to draw."""
    configure_logging(settings_of(tmp_path_factory.mktemp("logs"), log_level="error"))
    yield
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Sketch:
    """Only to be read: tests that change something take `fresh`."""
    folder = tmp_path_factory.mktemp("sketch") / "data"
    context, bell = open_sketch(settings_of(folder))
    finished = work(context, bell, spec("finished"))
    dim = {"constants": {"sun-1.elevation": 12}}
    failed = work(
        context, bell, spec("failed", **dim), broken=lambda job: job.kind == "layer" and job.frame.key.variant == 4
    )
    running = work(context, bell, spec("running", constants={"sun-1.elevation": 25}), products=150)
    waiting = work(context, bell, spec("waiting", renderer="pyrender"), products=0)
    context.engine.dispose()
    return Sketch(folder, finished, failed, running, waiting)


@pytest.fixture(scope="session")
def api(sketch: Sketch) -> Iterator[httpx.Client]:
    """A server over the four runs, to be read."""
    with served(create_app(settings_of(sketch.folder), control=False)) as client:
        yield client


@pytest.fixture
def fresh(sketch: Sketch, tmp_path: Path) -> Iterator[httpx.Client]:
    """A server over a copy of the four runs, to be changed."""
    shutil.copytree(sketch.folder, tmp_path / "data")
    with served(create_app(settings_of(tmp_path / "data"), control=False)) as client:
        yield client
