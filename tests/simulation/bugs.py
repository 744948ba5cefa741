"""Bugs to plant: a simulation that does not find them proves nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from unittest import mock

from sqlalchemy import Connection, update

from valerie.db import products, sweeping
from valerie.db.models import Product
from valerie.db.products import Finished


def _publish_what_is_not_held(connection: Connection, finished: list[Finished], *, owner: str, now: float) -> list[str]:
    digests = [product.digest for product in finished]
    values = {"state": "running", "lease_owner": owner}
    connection.execute(update(Product).where(Product.digest.in_(digests)).values(**values))
    return publish(connection, finished, owner=owner, now=now)


publish = products.publish
BUGS: dict[str, Callable[[], mock._patch]] = {  # type: ignore[type-arg]
    "lost-lease": lambda: mock.patch.object(sweeping, "take_back_expired", return_value=[]),
    "double-publication": lambda: mock.patch.object(products, "publish", _publish_what_is_not_held),
    "believed-clock": lambda: mock.patch.object(sweeping, "bound_times"),
    "lost-message": lambda: mock.patch.object(sweeping, "stale_ready", return_value=[]),
}


@contextmanager
def planted(name: str | None) -> Iterator[None]:
    """Plant a bug."""
    if name is None:
        yield
        return
    with BUGS[name]():
        yield
