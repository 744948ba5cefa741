"""Postgres behind a link that swallows every byte: nothing waits for ever."""

from __future__ import annotations

import socket
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text

from tests.chaos.link import Link
from tests.world.postgres import PostgresServer
from valerie.db.engine import open_database, reading, unbounded, writing
from valerie.errors import TransientError

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

#: Longer than a busy machine needs for a statement here.
SECONDS = 2.0
#: Until a call must have returned: far more than its bounds, far less than the hours of a kernel.
PATIENCE = 60.0


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="valerie-silent-") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[PostgresServer]:
    with PostgresServer(folder) as server:
        yield server


@contextmanager
def linked(server: PostgresServer, folder: Path, transport: str) -> Iterator[tuple[Link, Engine]]:
    with ExitStack() as stack:
        if transport == "tcp":
            link = stack.enter_context(Link(None, server.socket))
            url = f"postgresql://postgres@127.0.0.1:{link.port}/postgres"
        else:
            sockets = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=folder)))
            link = stack.enter_context(Link(sockets / server.socket.name, server.socket))
            url = server.url("postgres", sockets=sockets)
        engine = open_database(url, seconds=SECONDS)
        stack.callback(engine.dispose)
        yield link, engine


def one(engine: Engine) -> None:
    with reading(engine) as connection:
        assert connection.scalar(text("SELECT 1")) == 1


def outcome(call: Callable[[], None]) -> Exception | None:
    """What a call raised; it must return in time."""
    raised: list[Exception | None] = []

    def run() -> None:
        try:
            call()
            raised.append(None)
        except Exception as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert raised, f"still waiting after {PATIENCE:g} s"
    return raised[0]


@pytest.mark.parametrize("transport", ["unix", "tcp"])
def test_a_statement_on_a_link_that_became_silent_ends_and_is_tried_again(
    server: PostgresServer, folder: Path, transport: str
) -> None:
    with linked(server, folder, transport) as (link, engine):

        def fall_silent() -> None:
            with writing(engine) as connection:
                connection.execute(text("SELECT 1"))
                link.hang(0.0)
                connection.execute(text("SELECT 2"))

        assert isinstance(outcome(fall_silent), TransientError)
        assert outcome(lambda: one(engine)) is None


@pytest.mark.parametrize("transport", ["unix", "tcp"])
def test_connections_that_are_made_or_reused_on_a_silent_link_end(
    server: PostgresServer, folder: Path, transport: str
) -> None:
    with linked(server, folder, transport) as (link, engine):
        one(engine)  # leaves a connection in the pool
        silence = threading.Thread(target=link.hang, args=(PATIENCE,), daemon=True)
        silence.start()
        assert isinstance(outcome(lambda: one(engine)), TransientError)


def test_locks_of_a_client_behind_a_silent_link_are_released(server: PostgresServer, folder: Path) -> None:
    with linked(server, folder, "unix") as (link, engine), linked(server, folder, "unix") as (_, other):
        with writing(other) as connection:
            connection.execute(text("CREATE TABLE held (id integer)"))
        with engine.connect() as holder:
            holder.execute(text("LOCK TABLE held IN ACCESS EXCLUSIVE MODE"))
            link.hang(0.0)

            def insert() -> None:
                while True:
                    with (
                        suppress(TransientError),
                        writing(other) as connection,
                    ):  # the lock is awaited for a second each time
                        connection.execute(text("INSERT INTO held VALUES (1)"))
                        return

            assert outcome(insert) is None
            holder.invalidate()


def test_a_long_statement_ends_with_the_servers_reason_except_in_a_migration(
    server: PostgresServer, folder: Path
) -> None:
    with linked(server, folder, "unix") as (_, engine):

        def sleep() -> None:
            with reading(engine) as connection:
                connection.execute(text(f"SELECT pg_sleep({PATIENCE})"))

        assert "statement timeout" in str(outcome(sleep))
        with writing(engine) as connection, unbounded(connection):
            connection.execute(text(f"SELECT pg_sleep({2 * SECONDS})"))
        assert "statement timeout" in str(outcome(sleep))


def test_the_kernel_is_asked_to_find_a_lost_peer_of_tcp(server: PostgresServer, folder: Path) -> None:
    with linked(server, folder, "tcp") as (_, engine), engine.connect() as connection:
        driver: Any = connection.connection.driver_connection
        end = socket.socket(fileno=driver.fileno())
        alive = end.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        options = (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT, socket.TCP_USER_TIMEOUT)
        idle, interval, count, unanswered = (end.getsockopt(socket.IPPROTO_TCP, option) for option in options)
        end.detach()  # the driver's
    assert alive
    assert idle + interval * count <= 25
    assert 0 < unanswered <= 25_000
