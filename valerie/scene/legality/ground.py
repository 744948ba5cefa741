"""Heights of the ground on which persons and vehicles stand."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import shapely

from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.placements import MAX_COORDINATE_M

#: Largest difference in height of level ground, metres: the step of a dropped kerb.
STEP_M: Final = 0.03


def ground_height(manifest: Manifest, x: float, y: float) -> float:
    """Return the height of the ground at (x, y) in metres: that of the last region that contains or touches it, else 0."""
    for region in _regions(manifest):
        x0, y0, x1, y1 = region.bounds
        if x0 <= x <= x1 and y0 <= y <= y1 and shapely.intersects_xy(region.polygon, x, y):
            return region.height
    return 0.0


def level_ground(manifest: Manifest, height: float) -> shapely.Geometry:
    """Return all ground within `STEP_M` of a height (metres), prepared for fast tests."""
    end = 2.0 * MAX_COORDINATE_M
    level: shapely.Geometry = shapely.box(-end, -end, end, end) if abs(height) <= STEP_M else shapely.Polygon()
    for region in manifest.ground:
        polygon = shapely.make_valid(shapely.Polygon(region.polygon))
        level = level.union(polygon) if abs(region.height - height) <= STEP_M else level.difference(polygon)
    shapely.prepare(level)
    return level


class _Region(NamedTuple):
    """A region of level ground: its polygon, prepared for fast tests, the polygon's bounds (x0, y0, x1, y1), and its height."""

    polygon: shapely.Polygon
    bounds: tuple[float, float, float, float]
    height: float


@lru_cache(maxsize=16)
def _regions(manifest: Manifest) -> tuple[_Region, ...]:
    """Return the regions. The first one that contains a place decides."""
    regions = []
    for region in reversed(manifest.ground):
        polygon = shapely.Polygon(region.polygon)
        shapely.prepare(polygon)
        regions.append(_Region(polygon, polygon.bounds, region.height))
    return tuple(regions)
