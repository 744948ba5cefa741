"""Heights of the ground: where a person's feet are."""

from __future__ import annotations

from functools import lru_cache

import shapely

from valerie.scene.manifest import Manifest


def ground_height(manifest: Manifest, x: float, y: float) -> float:
    """Height in metres of the ground at (x, y): that of the last region that contains or touches it, else 0."""
    for polygon, (x0, y0, x1, y1), height in _regions(manifest):
        if x0 <= x <= x1 and y0 <= y <= y1 and shapely.intersects_xy(polygon, x, y):
            return height
    return 0.0


@lru_cache(maxsize=16)
def _regions(manifest: Manifest) -> tuple[tuple[shapely.Polygon, tuple[float, float, float, float], float], ...]:
    """Regions, the winning ones first."""
    found = []
    for region in reversed(manifest.ground):
        polygon = shapely.Polygon(region.polygon)
        shapely.prepare(polygon)
        found.append((polygon, polygon.bounds, region.height))
    return tuple(found)
