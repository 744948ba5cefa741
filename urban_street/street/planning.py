"""A street plan under construction: placements and footprints."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import shapely

from urban_street.street.plan import (
    Footprint,
    Placement,
    Point,
    Polygon,
    Spot,
    StreetLines,
    StreetSettings,
    lines_of,
)


class StreetPlan:
    """Placements and footprints of a street. Objects are numbered by class."""

    def __init__(self, settings: StreetSettings) -> None:
        self.settings = settings
        self.lines: StreetLines = lines_of(settings)
        self.placements: list[Placement] = []
        self.footprints: list[Footprint] = []
        self._numbers: Counter[str] = Counter()
        self._taken: list[shapely.Polygon] = []

    def add(self, object_class: str, kind: str, x: float, y: float, **more: Any) -> Placement:
        """Place an object; ``more`` has other fields of `Placement`."""
        self._numbers[object_class] += 1
        path = f"scene.{object_class}-{self._numbers[object_class]}"
        placement = Placement(path, kind, round(x, 4), round(y, 4), **more)
        self.placements.append(placement)
        return placement

    def block(self, placement: Placement, polygon: Polygon, height: float | None = None) -> None:
        """Add the footprint of an object (see `Footprint`)."""
        self.footprints.append(Footprint(placement.path, polygon, height))
        self._taken.append(shapely.Polygon(polygon))

    def is_free(self, polygon: Polygon, margin: float) -> bool:
        """Return True if no footprint is within ``margin`` metres of the polygon."""
        return not shapely.intersects(shapely.Polygon(polygon).buffer(margin), self._taken).any()

    def add_where_free(
        self, object_class: str, kind: str, spot: Spot, room: tuple[Point, Point], *, margin: float = 0.45,
        height: float | None = None, **more: Any,
    ) -> Placement | None:  # fmt: skip
        """Place an object on the pavement with its footprint, if its spot is free.

        Args:
            spot: the place to try.
            room: lowest and highest corner of its rectangle, in its own frame, metres.
            margin: free distance around it, metres.
            height: see `Footprint`.
            more: other fields of `Placement`.
        """
        polygon = replace(spot, x=round(spot.x, 4), y=round(spot.y, 4)).outline(*room)
        if not self.is_free(polygon, margin):
            return None
        z, heading = self.lines.kerb_height, spot.heading
        placement = self.add(object_class, kind, spot.x, spot.y, z=z, heading=heading, **more)
        self.block(placement, polygon, height)
        return placement
