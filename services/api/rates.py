"""Limits on the rate of requests, one for each caller."""

from __future__ import annotations

import math
import threading
from time import monotonic
from typing import Final

from cachetools import LRUCache

#: Callers whose rates are remembered; those that were silent for longest are forgotten first.
_CALLERS: Final = 10_000


class RateLimit:
    """Token buckets: a caller may send a minute's requests at once, and then as many as come in again.

    The buckets are in memory: each process of the API counts its own requests.

    Args:
        per_minute: requests of a caller; 0: no limit.
    """

    def __init__(self, per_minute: int) -> None:
        self._per_minute = per_minute
        self._lock = threading.Lock()
        #: Requests left, and the time of the last one, seconds.
        self._buckets: LRUCache[str, tuple[float, float]] = LRUCache(_CALLERS)

    def wait_for(self, caller: str) -> int:
        """Count a request; return 0 if it is within the limit, else the seconds until another one is."""
        if not self._per_minute:
            return 0
        per_second = self._per_minute / 60
        with self._lock:
            now = monotonic()
            left, before = self._buckets.get(caller, (float(self._per_minute), now))
            left = min(left + (now - before) * per_second, float(self._per_minute))
            allowed = left >= 1.0
            self._buckets[caller] = (left - allowed, now)
        return 0 if allowed else math.ceil((1.0 - left) / per_second)
