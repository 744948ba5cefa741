"""A street plan under construction: placements and footprints."""

from __future__ import annotations

from collections import Counter
from typing import Any

import shapely

from urban_street.street.plan import (
    Footprint,
    Lines,
    Placement,
    Polygon,
    StreetSettings,
    lines_of,
    turned_rectangle,
)


class Plan:
    """Placements and footprints of a street; objects of each class are numbered."""

    def __init__(self, settings: StreetSettings) -> None:
        self.settings = settings
        self.lines: Lines = lines_of(settings)
        self.placements: list[Placement] = []
        self.footprints: list[Footprint] = []
        self._numbers: Counter[str] = Counter()

    def add(self, object_class: str, kind: str, x: float, y: float, **more: Any) -> Placement:
        """Place an object; more: other fields of `Placement`."""
        self._numbers[object_class] += 1
        path = f"scene.{object_class}-{self._numbers[object_class]}"
        placement = Placement(path, kind, round(x, 4), round(y, 4), **more)
        self.placements.append(placement)
        return placement

    def block(self, placed: Placement, polygon: Polygon, height: float | None = None) -> None:
        """Add the footprint of an object (see `Footprint`)."""
        self.footprints.append(Footprint(placed.path, polygon, height))

    def is_free(self, polygon: Polygon, margin: float) -> bool:
        """Return whether nothing that blocks stands within ``margin`` metres of the polygon."""
        shape = shapely.Polygon(polygon).buffer(margin)
        return not any(shape.intersects(shapely.Polygon(footprint.polygon)) for footprint in self.footprints)

    def add_where_free(
        self, object_class: str, kind: str, x: float, y: float, low: tuple[float, float], high: tuple[float, float],
        *, heading: float, margin: float = 0.45, height: float | None = None, **more: Any,
    ) -> Placement | None:  # fmt: skip
        """Place and block an object with the given rectangle in its own frame, if its place is free."""
        polygon = turned_rectangle(round(x, 4), round(y, 4), heading, low, high)
        if not self.is_free(polygon, margin):
            return None
        placement = self.add(object_class, kind, x, y, z=self.lines.kerb_height, heading=heading, **more)
        self.block(placement, polygon, height)
        return placement
