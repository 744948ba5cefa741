"""Bugs to plant. A simulation that misses them proves nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple
from unittest import mock

from sqlalchemy import Connection, update

from valerie.db import publishing, sweeping
from valerie.db.models import Product
from valerie.db.publishing import Finished

publish = publishing.publish


def publish_what_is_not_held(connection: Connection, finished: list[Finished], *, owner: str, now: float) -> list[str]:
    """See `valerie.db.publishing.publish`, without its condition."""
    digests = [product.digest for product in finished]
    values = {"state": "running", "lease_owner": owner}
    connection.execute(update(Product).where(Product.digest.in_(digests)).values(**values))
    return publish(connection, finished, owner=owner, now=now)


class Bug(NamedTuple):
    """A bug and a fault that reveals it quickly."""

    plant: Callable[[], Any]
    fault: str


BUGS = {
    "lost-lease": Bug(lambda: mock.patch.object(sweeping, "take_back_expired", return_value=[]), "kill worker"),
    "double-publication": Bug(
        lambda: mock.patch.object(publishing, "publish", publish_what_is_not_held), "freeze worker"
    ),
    "believed-clock": Bug(lambda: mock.patch.object(sweeping, "bound_times"), "clock back"),
    "lost-message": Bug(lambda: mock.patch.object(sweeping, "stale_ready", return_value=[]), "empty broker"),
}
