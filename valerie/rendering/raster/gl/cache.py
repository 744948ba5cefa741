"""A small cache with a fixed capacity, whose entries own GL objects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, Protocol, TypeVar


class Releasable(Protocol):
    """An object that owns GL objects until its release."""

    def release(self) -> None: ...


Entry = TypeVar("Entry", bound=Releasable)


class LeastRecentlyUsed(Generic[Entry]):
    """A cache of the most recently used entries. It releases the entries that it drops, so that memory stays bounded.

    Args:
        capacity: largest number of entries, at least 1.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._entries: OrderedDict[Hashable, Entry] = OrderedDict()

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._entries

    def __iter__(self) -> Iterator[Entry]:
        """Iterate over the entries, the most recently used one last."""
        return iter(tuple(self._entries.values()))

    def get(self, key: Hashable, make: Callable[[], Entry]) -> Entry:
        """Return the entry of ``key``, after creating it with ``make`` if it is missing."""
        entry = self._entries.get(key)
        if entry is not None:
            self._entries.move_to_end(key)
            return entry
        while len(self._entries) >= self._capacity:
            self._entries.popitem(last=False)[1].release()
        entry = make()
        self._entries[key] = entry
        return entry

    def clear(self) -> None:
        """Release every entry."""
        while self._entries:
            self._entries.popitem()[1].release()
