"""The order in which products of several runs are served: start-time fair queueing (doi:10.1145/248157.248171).

A run of priority *high* gets `Priority.weight` times the products of a run of priority *normal*, while both have some.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from valerie.runs.products.states import ProductKind

#: Products per packet: large enough to spread overhead, small enough that a killed worker loses little.
_PACKET: Final = 24
#: Exceptions: a background takes as long as many layers; 8 predictions are two batches of a GPU.
_PACKETS: Final = {ProductKind.BACKGROUND: 1, ProductKind.PREDICTION: 8}


def packet_size(kind: ProductKind) -> int:
    """Return the largest number of products of a kind that a worker takes at once."""
    return _PACKETS.get(kind, _PACKET)


@dataclass(slots=True)
class _Packet:
    turn: float
    room: int


class Turns:
    """Gives the products of one run their turns, in the order in which they are wanted.

    Products of one queue, kind and cache group that follow each other share a turn: a worker takes them as one packet. Such a
    packet is served before all packets with a later turn.

    Args:
        start: first turn. A run that begins or pauses starts at the turn that is being served, so it claims no time that passed.
        weight: the run's share beside runs of weight 1.
    """

    def __init__(self, start: float = 0.0, weight: float = 1.0) -> None:
        self._start, self._weight = start, weight
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
