"""Shapes that no few numbers describe, as plain data: a cross-section swept along a line, a raised slab, a set of signals.

A *sweep* is the closed ground of a whole place: a road with its verges, or a car park. A *slab* stands on it: a pavement, an
island. Together they describe any place's ground without a mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

Point = tuple[float, float]
Polygon = tuple[Point, ...]
#: A distance from the line in metres, or its course: (metres along, distance), linear in between.
Edge = float | tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Strip:
    """A strip of a cross-section, from the edge of the strip before it.

    Attributes:
        object_class: class of its object, e.g. ``road``.
        edge: its far edge, metres to the right of the line.
        height: height of its far edge, metres.
    """

    object_class: str
    material: str
    edge: Edge
    height: float = 0.0


@dataclass(frozen=True, slots=True)
class Mark:
    """A rectangle of another material in a sweep: metres along the line and to its right. Later ones are over earlier ones."""

    along: tuple[float, float]
    across: tuple[float, float]
    material: str = "road-marking"


@dataclass(frozen=True, slots=True)
class Sweep:
    """A cross-section swept along a line.

    Attributes:
        line: the line's corners, metres; the cross-section's right is the line's right.
        edge: left edge of the first strip.
        strips: the strips from left to right.
        marks: markings, on strips whose edges are straight there.
        step: longest piece along the line, metres.
    """

    line: Polygon
    edge: float
    strips: tuple[Strip, ...]
    marks: tuple[Mark, ...] = ()
    step: float = 4.0


@dataclass(frozen=True, slots=True)
class Slab:
    """Level ground with a kerb around it, on a sweep at height 0.

    Attributes:
        outline: counter-clockwise, metres.
        height: height of its top, metres.
        material: of its top, within the kerb.
    """

    outline: Polygon
    height: float
    material: str = "slabs"


@dataclass(frozen=True, slots=True)
class Head:
    """A signal head: its foot (metres), the heading to which it shows its lenses (radians), and its group in the program.

    Attributes:
        lift: height of the head above its usual place on a post.
    """

    x: float
    y: float
    heading: float
    group: str
    lift: float = 0.0


@dataclass(frozen=True, slots=True)
class Signals:
    """All signal heads of a crossing, which show one phase."""

    heads: tuple[Head, ...]


#: Phase to the lamps that are lit, by group: the streets along y and x, and the people who cross them.
PHASES: Final[dict[str, dict[str, tuple[str, ...]]]] = {
    "along-green": {"along": ("green",), "across": ("red",), "over-along": ("red",), "over-across": ("green",)},
    "along-amber": {"along": ("amber",), "across": ("red",), "over-along": ("red",), "over-across": ("red",)},
    "all-red": {"along": ("red",), "across": ("red",), "over-along": ("red",), "over-across": ("red",)},
    "along-red-amber": {"along": ("red", "amber"), "across": ("red",), "over-along": ("red",), "over-across": ("red",)},
    "across-green": {"along": ("red",), "across": ("green",), "over-along": ("green",), "over-across": ("red",)},
    "out-of-order": {},
}
DEFAULT_PHASE: Final = "across-green"

Shape = Sweep | Slab | Signals


def dashes(start: float, stop: float, line: float, gap: float, across: tuple[float, float]) -> tuple[Mark, ...]:
    """Return a broken marking: lines of length ``line`` with gaps between, metres."""
    count = int((stop - start + gap) // (line + gap))
    return tuple(Mark((start + k * (line + gap), start + k * (line + gap) + line), across) for k in range(count))


def bars(along: tuple[float, float], start: float, stop: float, line: float, gap: float) -> tuple[Mark, ...]:
    """Return the bars of a zebra crossing, from ``start`` to ``stop`` across the road."""
    return tuple(Mark(along, mark.along) for mark in dashes(start, stop, line, gap, along))
