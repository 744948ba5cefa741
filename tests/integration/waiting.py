"""Transactions that wait for each other, on Postgres."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import Engine, select, text

from valerie.db.models import Product

_WAITING = text("SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND wait_event_type = 'Lock'")


@contextmanager
def locked(engine: Engine, digest: str) -> Iterator[None]:
    """Hold the row of a product during the body."""
    with engine.begin() as connection:
        connection.execute(select(Product.digest).where(Product.digest == digest).with_for_update())
        yield


def wait_for_locks(engine: Engine, count: int) -> None:
    """Return when this many transactions of the database wait for a lock."""
    latest = time.monotonic() + 30.0
    while time.monotonic() < latest:
        with engine.connect() as connection:
            if connection.scalar(_WAITING) == count:
                return
        time.sleep(0.01)
    raise AssertionError("the transactions do not wait")
