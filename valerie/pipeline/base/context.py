"""Settings, database, artifact store and broker of a process, opened once and passed to every use case."""

from __future__ import annotations

import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace

from sqlalchemy import Engine

from valerie.broker import Broker
from valerie.db.archives import ARCHIVES
from valerie.db.engine import open_database
from valerie.pipeline.base.archives import StoredArchives
from valerie.pipeline.base.fitness import Fitness
from valerie.pipeline.base.tracing import Traces, open_traces
from valerie.settings import Settings
from valerie.storage.bounded_folder import BoundedFolder
from valerie.storage.store import ArtifactStore, open_store


@contextmanager
def beating_in_a_thread(seconds: float, beat: Callable[[], None]) -> Iterator[None]:
    """Call ``beat`` every ``seconds`` while the body runs."""
    stop = threading.Event()

    def run() -> None:
        while not stop.wait(seconds):
            beat()

    thread = threading.Thread(target=run, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(timeout=5)


@dataclass(frozen=True, slots=True)
class Context:
    """Settings and connections of a process.

    Attributes:
        settings: settings of the deployment.
        engine, store, broker: database, artifact store and message broker.
        owner: unique name of this process in leases: host, process id and a random part.
        elapsed: returns seconds of a monotonic clock, for the pauses of this process.
        beating: see `beating_in_a_thread`.
        fitness: tells a worker when to stop; without one, a worker is always fit.
        traces: writes the spans of frames and products.
    """

    settings: Settings
    engine: Engine
    store: ArtifactStore
    broker: Broker
    owner: str
    elapsed: Callable[[], float] = time.monotonic
    beating: Callable[[float, Callable[[], None]], AbstractContextManager[None]] = beating_in_a_thread
    fitness: Fitness = field(default_factory=Fitness)
    traces: Traces = field(default_factory=Traces)


def open_context(settings: Settings) -> Context:
    """Open everything that ``settings`` names.

    Raises:
        StorageUnavailable: the artifact store cannot be written.
        InvalidInput: a URL has an unknown scheme.
        MissingDependency: the settings ask for traces, and OpenTelemetry is not installed.
    """
    owner = process_name()
    engine = open_database(settings.database_url, seconds=settings.database_seconds)
    store = open_store(settings.artifacts_url, s3_endpoint=settings.s3_endpoint)
    folder = BoundedFolder(settings.data_dir / "archives", max_bytes=settings.archive_cache_mb * 2**20)
    engine.update_execution_options(**{ARCHIVES: StoredArchives(engine, store, folder)})
    return Context(
        settings=settings,
        engine=engine,
        store=store,
        broker=Broker(settings),
        owner=owner,
        traces=open_traces(settings, owner),
    )


def hurried(context: Context, seconds: float) -> Context:
    """Return the context with an engine of its own, whose statements end after a time on Postgres."""
    engine = open_database(context.settings.database_url, seconds=seconds)
    engine.update_execution_options(**{ARCHIVES: context.engine.get_execution_options()[ARCHIVES]})
    return replace(context, engine=engine)


def process_name() -> str:
    """Return ``host-pid-random``, unique among all processes; at most 64 characters."""
    return f"{socket.gethostname()[:40]}-{os.getpid()}-{secrets.token_hex(4)}"
