"""The order in which products of several owners and runs are served: start-time fair queueing (doi:10.1145/248157.248171).

There are two levels. Each owner has a line, in which runs share by weight: while both have products, a run of weight 4 gets four
times the products of a run of weight 1. Each queue serves the lines of all owners equally, however many runs are in them.
Turns count the products in a line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from valerie.runs.products.states import ProductKind

#: Products per packet: large enough to spread overhead, small enough that a killed worker loses little.
_PACKET: Final = 24
#: Exceptions: a background takes as long as many layers; 8 predictions are two batches of a GPU.
_PACKETS: Final = {ProductKind.BACKGROUND: 1, ProductKind.PREDICTION: 8}
_NONE: Final[Mapping[str, float]] = MappingProxyType({})


def packet_size(kind: ProductKind) -> int:
    """Return the largest number of products of a kind that a worker takes at once."""
    return _PACKETS.get(kind, _PACKET)


@dataclass(slots=True)
class _Packet:
    turn: float
    room: int


class Turns:
    """Gives the products of one run their turns in its owner's line, in the order in which they are wanted.

    Products of one queue, kind and cache group that follow each other share a turn: a worker takes them as one packet. Such a
    packet is served before all packets of the line with a later turn.

    Args:
        start: first turn. A run that begins or pauses starts no earlier than at the line's present turn, so it claims no time
            that passed.
        weight: the run's share beside runs of weight 1 of the same owner.
        owner: of the run; empty: the operator.
        present: owner to present turn, for each line that is not empty.
    """

    def __init__(
        self, start: float = 0.0, weight: float = 1.0, *, owner: str = "", present: Mapping[str, float] = _NONE
    ) -> None:
        self.owner = owner
        self._present = present
        self._start, self._weight = max(start, present.get(owner, start)), weight
        self._count = 0
        self._packets: dict[tuple[str, ProductKind, str], _Packet] = {}

    @property
    def following(self) -> float:
        """The turn of the product after the last."""
        return self._start + self._count / self._weight

    def take(self, route: str, kind: ProductKind, cache_group: str) -> float:
        """Return the turn of the next product."""
        key = route, kind, cache_group
        packet = self._packets.get(key)
        if packet is None or not packet.room:
            packet = self._packets[key] = _Packet(self.following, packet_size(kind))
        packet.room -= 1
        self._count += 1
        return packet.turn

    def is_sooner(self, turn: float, other: float, owner: str) -> bool:
        """Return True if a turn in this line is nearer to the line's present turn than another one is in an owner's line."""
        if owner == self.owner:
            return turn < other
        return turn - self._present.get(self.owner, self._start) < other - self._present.get(owner, other)
