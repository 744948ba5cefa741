"""Functions under test within this deployment's bounds on untrusted networks.

Workers, `valerie replay`, `valerie evaluate` and comparisons of versions all open functions through `open_bounded`. A function
that requests too much memory fails; one that takes too long ends this process, since nothing else stops compiled code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from valerie.errors import TransientError
from valerie.perception.base import BatchFunction, FunctionCard, PerceptionFunction
from valerie.perception.running.http_function import HttpFunction
from valerie.perception.running.limits import limit_memory, time_limit
from valerie.settings import Settings


def open_bounded(
    open_it: Callable[[], PerceptionFunction],
    settings: Settings,
    *,
    name: str,
    before_end: Callable[[str], None] | None = None,
) -> BoundedFunction:
    """Open a function; ``infer_memory_mb`` and ``infer_seconds`` bound the opening and every picture.

    Args:
        open_it: opens the function.
        settings: settings of this deployment.
        name: name of the function in messages.
        before_end: called with the reason, in another thread, before a picture that takes too long ends this process.

    Raises:
        TransientError: opening it needs more memory than it may have.
        ValerieError: from ``open_it``.
    """
    bounds = _Bounds(settings, name, before_end)
    try:
        with bounds.around(f"opening {name}"):
            return BoundedFunction(open_it(), bounds)
    except BaseException:
        bounds.lift_memory()
        raise


class BoundedFunction:
    """A function whose predictions are bounded (see `BatchFunction`).

    The time limit of several pictures is that of one times their number.
    """

    def __init__(self, function: PerceptionFunction, bounds: _Bounds) -> None:
        self._function, self._bounds = function, bounds
        # A function behind HTTP has its own time-out; ending this process would send the picture a second time.
        self._timed = not isinstance(function, HttpFunction)

    @property
    def revision(self) -> int:
        return self._function.revision

    @property
    def card(self) -> FunctionCard:
        return self._function.card

    @property
    def numeric_class(self) -> str:
        return self._function.numeric_class

    @property
    def batch_size(self) -> int:
        """1 for a function that takes one picture at a time."""
        return self._function.batch_size if isinstance(self._function, BatchFunction) else 1

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """See `PerceptionFunction`.

        Raises:
            TransientError: it needs more memory than it may have.
        """
        with self._bounds.around(self._bounds.name, pictures=int(self._timed)):
            return self._function.predict(picture)

    def predict_many(self, pictures: Sequence[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
        """See `BatchFunction`.

        Raises:
            TransientError: they need more memory than it may have.
        """
        if not isinstance(self._function, BatchFunction):
            return [self.predict(picture) for picture in pictures]
        with self._bounds.around(self._bounds.name, pictures=len(pictures) * self._timed):
            return self._function.predict_many(pictures)

    def close(self) -> None:
        """Close the function and lift the memory limit."""
        try:
            self._function.close()
        finally:
            self._bounds.lift_memory()


class _Bounds:
    """The bounds of one function: on memory until `lift_memory`, on time around each piece of work."""

    def __init__(self, settings: Settings, name: str, before_end: Callable[[str], None] | None) -> None:
        self.name = name
        self._settings, self._before_end = settings, before_end
        self.lift_memory = limit_memory(settings.infer_memory_mb)

    @contextmanager
    def around(self, what: str, *, pictures: int = 1) -> Iterator[None]:
        """Bound the body; with 0 ``pictures`` its time is unlimited."""
        seconds = self._settings.infer_seconds * pictures
        try:
            with time_limit(seconds, what=what, before_end=self._before_end):
                yield
        except MemoryError as error:
            limit = f"limit: {self._settings.infer_memory_mb} MB (VALERIE_INFER_MEMORY_MB)"
            raise TransientError(
                f"{what} needs more memory than it may have: {error or 'MemoryError'}; {limit}"
            ) from error
