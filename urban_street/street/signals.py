"""The signals of a crossing. One phase sets all heads, so that no two groups are in conflict."""

from __future__ import annotations

from typing import Final

from urban_street.solids.surfaces import Bag, boxes, pose
from urban_street.street.furniture import signal_lens, signal_visor
from urban_street.street.plan import Placement
from urban_street.street.shapes import PHASES, Signals

#: Lamps of a head for vehicles and of one for people, by aspect, with their heights in metres.
_VEHICLES: Final = {"red": 3.15, "amber": 2.85, "green": 2.55}
_PEOPLE: Final = {"red": 2.85, "green": 2.55}


def _lamps(group: str) -> dict[str, float]:
    return _PEOPLE if group.startswith("over-") else _VEHICLES


def heads(placement: Placement) -> Bag:
    """Build the housings of all heads, with visors and backs, without lenses."""
    assert isinstance(placement.shape, Signals)
    bag = Bag()
    for head in placement.shape.heads:
        own = Bag()
        heights = _lamps(head.group).values()
        low, high = min(heights) - 0.15, max(heights) + 0.15
        own.add("frame-dark", boxes([[-0.15, -0.1, low]], [[0.15, 0.12, high]]))
        if len(heights) == len(_VEHICLES):
            own.add("frame-dark", boxes([[-0.24, 0.12, low - 0.1]], [[0.24, 0.135, high + 0.1]]))
        own.add("visor", *(signal_visor(z) for z in heights))
        bag.merge(own, pose(head.x, head.y, head.lift, head.heading))
    return bag


def lenses(signals: Signals, phase: str) -> Bag:
    """Build the lenses of all heads in a phase of `PHASES`."""
    bag = Bag()
    for head in signals.heads:
        own = Bag()
        for aspect, z in _lamps(head.group).items():
            lit = aspect in PHASES[phase].get(head.group, ())
            own.add(f"signal-{aspect}" if lit else "signal-off", signal_lens(z))
        bag.merge(own, pose(head.x, head.y, head.lift, head.heading))
    return bag
