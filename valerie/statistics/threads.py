"""The threads of scikit-learn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep scikit-learn to one thread, so that a sum does not depend on the number of cores.

    Further threads gain nothing on so few rows, and spin where cores are busy.
    """
    import sklearn.ensemble  # noqa: F401  # only loaded libraries can be limited
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield
