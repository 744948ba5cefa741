"""A small cache with a fixed number of entries, whose entries own GL objects."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, Protocol, TypeVar


class Releasable(Protocol):
    """Something that holds GL objects until it is told to let go."""

    def release(self) -> None: ...


Entry = TypeVar("Entry", bound=Releasable)


class LeastRecentlyUsed(Generic[Entry]):
    """Keeps the entries used last, and releases what it drops: memory stays flat over any number of frames.

    Args:
        capacity: largest number of entries, at least 1.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._entries: OrderedDict[Hashable, Entry] = OrderedDict()

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[Entry]:
        """The entries, the one used last at the end."""
        return iter(tuple(self._entries.values()))

    def get(self, key: Hashable, make: Callable[[], Entry]) -> Entry:
        """Return the entry of ``key``, made now if it is not there."""
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
