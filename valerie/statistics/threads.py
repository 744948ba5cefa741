"""The threads of scikit-learn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep scikit-learn to one thread, so that a sum does not depend on the number of cores.

    Further threads gain nothing on so few rows, and spin where cores are busy.
    """
    with _controller().limit(limits=1):
        yield


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the libraries that scikit-learn loads; finding them takes as long as a small fit."""
    import sklearn.ensemble  # noqa: F401  # only loaded libraries can be limited
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
