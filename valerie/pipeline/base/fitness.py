"""Doubt about a worker: its failures in a row may be those of the products or of the machine."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, MutableSequence
from typing import Final

#: Failures in a row after which a worker tests itself.
_FAILURES: Final = 3

#: Failures in a row, and the number at which the next test is due; as an array, in memory that processes share.
Counts = MutableSequence[int] | ctypes.Array[ctypes.c_int]


class Fitness:
    """Counts the products that a worker began without success since the last one that it made, and tests it after three.

    Only the test decides: products may fail on every machine. After a test that passes, twice as many failures are needed for
    the next one, so that a run whose products all fail costs few tests.

    Args:
        test: tests the machine and returns True if it works.
        counts: where to count. The processes that follow each other as children of one worker share it, since a child that died
            does not count its own death.
    """

    def __init__(self, test: Callable[[], bool] = lambda: True, counts: Counts | None = None) -> None:
        self._test = test
        self._counts: Counts = self.counts() if counts is None else counts

    @staticmethod
    def counts() -> list[int]:
        """Return the counts of a worker that begins."""
        return [0, _FAILURES]

    def fit(self) -> bool:
        """Return True if the worker may go on; where a test is due, make it."""
        failures, due = self._counts
        if failures < due:
            return True
        if not self._test():
            return False
        self._counts[1] = 2 * failures
        return True

    def begin(self) -> None:
        """Count a product; it is a failure until `succeed`."""
        self._counts[0] += 1

    def succeed(self) -> None:
        """Forget all failures, since a product was made."""
        self._counts[:] = self.counts()
