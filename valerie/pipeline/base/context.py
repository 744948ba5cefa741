"""Settings, database, artifact store and broker of a process, opened once and passed to every use case."""

from __future__ import annotations

import os
import secrets
import socket
from dataclasses import dataclass

from sqlalchemy import Engine

from valerie.broker import Broker, create_app
from valerie.db.engine import open_engine
from valerie.settings import Settings
from valerie.storage.store import ArtifactStore, open_store


@dataclass(frozen=True, slots=True)
class Context:
    """Settings and connections of a process.

    Attributes:
        settings: of the deployment.
        engine, store, broker: database, artifact store and message broker.
        owner: unique name of this process in leases: host, process id and a random part.
    """

    settings: Settings
    engine: Engine
    store: ArtifactStore
    broker: Broker
    owner: str


def open_context(settings: Settings) -> Context:
    """Open everything that ``settings`` names.

    Raises:
        StorageUnavailable: the artifact store cannot be written.
        InvalidInput: a URL of an unknown kind.
    """
    return Context(
        settings=settings,
        engine=open_engine(settings.database_url),
        store=open_store(settings.artifacts_url, s3_endpoint=settings.s3_endpoint),
        broker=Broker(create_app(settings)),
        owner=process_name(),
    )


def process_name() -> str:
    """Return ``host-pid-random``, unique among all processes that ever held a lease; at most 64 characters."""
    return f"{socket.gethostname()[:40]}-{os.getpid()}-{secrets.token_hex(4)}"
