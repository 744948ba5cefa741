"""A street plan under construction: placements and footprints."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from urban_street.street.plan import (
    Footprint,
    GroundRegion,
    Placement,
    Spot,
    StreetLayout,
    StreetLines,
    StreetSettings,
    disc,
    lines_of,
)
from urban_street.street.shapes import Point, Polygon, Slab, Sweep
from urban_street.vehicles.build import KINDS, dimensions


def seed_of(rng: np.random.Generator) -> int:
    """Draw the seed of an object."""
    return int(rng.integers(2**31))


class StreetPlan:
    """Placements and footprints of a street. Objects are numbered by class."""

    def __init__(self, settings: StreetSettings) -> None:
        self.settings = settings
        self.lines: StreetLines = lines_of(settings)
        self.placements: list[Placement] = []
        self.footprints: list[Footprint] = []
        self.ground: list[GroundRegion] = []
        self._numbers: Counter[str] = Counter()
        self._taken: list[shapely.Polygon] = []

    def add(self, object_class: str, kind: str, x: float, y: float, **more: Any) -> Placement:
        """Place an object; ``more`` has other fields of `Placement`."""
        self._numbers[object_class] += 1
        path = f"scene.{object_class}-{self._numbers[object_class]}"
        placement = Placement(path, kind, round(x, 4), round(y, 4), **more)
        self.placements.append(placement)
        return placement

    def block(self, placement: Placement, polygon: Polygon, height: float | None = None, reason: str = "") -> None:
        """Add the footprint of an object (see `Footprint`)."""
        self.footprints.append(Footprint(placement.path, polygon, height, reason))
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

    def sweep(self, sweep: Sweep) -> None:
        """Add the ground of a place, one object for each of its classes."""
        for object_class in dict.fromkeys(strip.object_class for strip in sweep.strips):
            self.add(object_class, "sweep", 0.0, 0.0, shape=sweep)

    def slab(self, outline: Polygon, object_class: str = "sidewalk", material: str = "slabs") -> None:
        """Add a pavement or an island, whose ground is as high as the kerbs."""
        height = self.lines.kerb_height
        self.add(object_class, "slab", 0.0, 0.0, shape=Slab(outline, height, material))
        self.ground.append(GroundRegion(outline, height))

    def stand(
        self, object_class: str, kind: str, spot: Spot, radius: float, *, height: float | None = None, **more: Any
    ) -> Placement:
        """Place an object on the ground at ``spot``, where it takes a disc (metres; ``height``: see `Footprint`)."""
        z = self.height(spot.x, spot.y)
        placement = self.add(object_class, kind, spot.x, spot.y, **{"z": z, "heading": spot.heading, **more})
        self.block(placement, disc(spot.x, spot.y, radius), height)
        return placement

    def park(self, kind: str, spot: Spot, variant: int = 0) -> Placement:
        """Place a vehicle on the ground, with the outline of its kind."""
        length, width, _ = dimensions(kind)
        z = self.height(spot.x, spot.y)
        vehicle = self.add(KINDS[kind], kind, spot.x, spot.y, z=z, heading=spot.heading, variant=variant)
        self.block(vehicle, spot.outline((-0.5 * width, -0.5 * length), (0.5 * width, 0.5 * length)))
        return vehicle

    def height(self, x: float, y: float) -> float:
        """Return the height of the slabs at a place, metres."""
        under = (r.height for r in reversed(self.ground) if shapely.intersects_xy(shapely.Polygon(r.polygon), x, y))
        return next(under, 0.0)

    def layout(self, extent: tuple[float, float, float, float]) -> StreetLayout:
        """Return the finished plan, within x0, y0, x1, y1."""
        return StreetLayout(self.settings, tuple(self.placements), tuple(self.footprints), tuple(self.ground), extent)
