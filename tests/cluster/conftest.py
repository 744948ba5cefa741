"""Fixtures of the tests of clusters: a run in peace through Redis, and the assets of its scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.system import System
from tests.cluster.rabbitmq import rabbitmq
from tests.integration.conftest import new_database  # noqa: F401  # a fixture
from tests.world.boxes import spec, write_box_street

DOCUMENT = spec(xs=4, ys=3)

Outcome = tuple[list[dict[str, object]], dict[str, str]]


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the asset of `DOCUMENT`."""
    folder = tmp_path_factory.mktemp("assets")
    write_box_street(folder / "box-street")
    return folder


@pytest.fixture(scope="session")
def calm(assets: Path, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Rows and objects of the run on one machine, through Redis."""
    with System(tmp_path_factory.mktemp("calm"), assets) as system:
        run = system.submit(DOCUMENT)
        assert system.wait(run) == "completed"
        return system.rows(run), system.objects()


@pytest.fixture(scope="session")
def rabbitmq_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A RabbitMQ server of this session."""
    with rabbitmq(tmp_path_factory.mktemp("rabbitmq")) as url:
        yield url
