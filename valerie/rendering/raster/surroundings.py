"""Indirect light: an estimate, from a sample of surfaces, of the light that a street reflects. Pure numpy.

The sky light of the raster engine (``skylight.frag``) knows the directions in which a surface hides the sky, but not the
surface. It uses the mean radiance of all surfaces that face the place, each with its own colour and the sun and sky that reach
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points
from valerie.rendering.sky import Sky

#: Places on the statics, over their area.
SAMPLE: Final = 4096
#: Tries to find a place of a triangle that lies in the street: those that a ground up to the horizon needs.
_TRIES: Final = 128
#: Metres around the street's core in which its surfaces are taken.
_AROUND: Final = 1.0
#: Metres above the lowest: what faces up in between is ground, what lies higher may be a roof.
_GROUND_BAND: Final = 2.0
#: Largest upward component of a wall's normal.
_WALL_SLOPE: Final = 0.3
#: The sun is seen from a place as the directions of the sky around it are.
_AROUND_SUN: Final = np.cos(np.deg2rad(25.0))
#: Step between the places that stand for all others.
_EVERY: Final = 16
#: Weight of a place that faces no other.
_ALONE: Final = 0.01
#: Light goes from surface to surface so often; a further time adds some percent of the first.
_BOUNCES: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSample:
    """Places on surfaces, each for the same area; a thin sheet counts with both its sides.

    Attributes:
        points: (N, 3) metres, in the world.
        normals: (N, 3) unit vectors, of the triangles.
        rows: (N,) rows of their materials.
        lowest: metres, from where on the ground may be.
        area: m² that each place stands for.
    """

    points: Points
    normals: Points
    rows: NDArray[np.intp]
    lowest: float
    area: float

    @classmethod
    def empty(cls, lowest: float) -> SurfaceSample:
        """Build a sample without places."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.intp), lowest, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Reflected:
    """Light that comes from surfaces, linear RGB in the image's unit.

    Attributes:
        hidden: (K, 3) radiance of what hides the sky in each direction.
        ground: (3,) radiance of the ground.
        on_walls: (3,) mean light on walls: the radiance of white ones.
    """

    hidden: Points
    ground: Points
    on_walls: Points


def sample_surfaces(
    positions: NDArray[np.float32],
    faces: NDArray[np.uint32],
    rows: NDArray[np.uint32],
    two_sided: NDArray[np.bool_],
    low: Points,
    high: Points,
) -> SurfaceSample:
    """Return a sample of the triangles between two corners (3,), of equal area each and the same in every process.

    Args:
        positions: (V, 3) metres.
        faces: (T, 3), counter-clockwise seen from outside.
        rows: (T,) of materials.
        two_sided: (T,) whether the other side is seen as well.
    """
    first, second, third = (positions[faces[:, k]] for k in range(3))
    across = np.cross(second - first, third - first)
    double = np.linalg.norm(across, axis=1)
    least, largest = np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
    low, high = low - _AROUND, high + _AROUND
    # A triangle that sticks out counts by the share of its bounding box that lies inside.
    inside = np.maximum(np.minimum(largest, high) - np.maximum(least, low), 0)
    touches = ((largest >= low) & (least <= high)).all(axis=1)
    share = np.where(largest > least, inside / np.maximum(largest - least, 1e-9), 1.0).prod(axis=1)
    summed = np.cumsum(double * share * touches, dtype=np.float64)
    if not len(summed) or not summed[-1] > 0:
        return SurfaceSample.empty(float(low[2] + _AROUND))
    picked = np.searchsorted(summed, (np.arange(SAMPLE) + 0.5) / SAMPLE * summed[-1])
    points = _places(first[picked], second[picked], third[picked], low, high)
    there = ((points >= low) & (points <= high)).all(axis=1)
    points, picked = points[there], picked[there]
    normals = across[picked].astype(np.float64) / double[picked, None]
    both = two_sided[picked]
    return SurfaceSample(
        np.concatenate([points, points[both]]),
        np.concatenate([normals, -normals[both]]),
        np.concatenate([rows[picked], rows[picked][both]]).astype(np.intp),
        float(low[2] + _AROUND),
        float(summed[-1]) / 2 / SAMPLE,
    )


def _places(first: Points, second: Points, third: Points, low: Points, high: Points) -> Points:
    """Return a place in each triangle, (N, 3), between the corners if one of `_TRIES` is."""
    # Evenly over the unit square, whatever part is taken: the R₂ sequence, Roberts 2018, "The unreasonable effectiveness of
    # quasirandom sequences".
    count = len(first)
    number = np.arange(count * _TRIES).reshape(_TRIES, count)
    points = np.empty((count, 3))
    open_ones = np.ones(count, np.bool_)
    for tried in number:
        across, up = (
            (0.5 + tried[open_ones] * 0.7548776662466927) % 1.0,
            (0.5 + tried[open_ones] * 0.5698402909980532) % 1.0,
        )
        over = across + up > 1.0
        across, up = np.where(over, 1 - across, across)[:, None], np.where(over, 1 - up, up)[:, None]
        origin = first[open_ones].astype(np.float64)
        candidates = origin + (second[open_ones] - origin) * across + (third[open_ones] - origin) * up
        points[open_ones] = candidates
        open_ones[open_ones] = ~((candidates >= low) & (candidates <= high)).all(axis=1)
        if not open_ones.any():
            break
    return points


def prominence(sample: SurfaceSample, openness: NDArray[np.bool_]) -> Points:
    """Return the weight of each place, (N,), in the view of other places.

    Light goes to and fro alike: others see a place as much as it sees of them. That is the share of its view that they fill (form
    factors of discs, Wallace, Elmquist and Haines 1989, "A ray tracing algorithm for progressive radiosity"), taken from some of
    the places and as if nothing stood between. So walls towards a street count for more than the backs of its houses, roofs and
    what faces the outside. Places from which no direction is open (rooms, what lies under the road) count for nothing.

    Args:
        openness: as for `reflected`.
    """
    there: NDArray[np.bool_] = np.asarray(openness.any(axis=1))
    points = sample.points - sample.points.mean(axis=0) if len(there) else sample.points
    others = slice(None, None, _EVERY)
    theirs, normals = points[others], sample.normals[others]
    along = sample.normals @ theirs.T - (sample.normals * points).sum(axis=1)[:, None]
    back = points @ normals.T - (normals * theirs).sum(axis=1)
    squared = (points**2).sum(axis=1)[:, None] + (theirs**2).sum(axis=1) - 2 * points @ theirs.T
    squared = np.maximum(squared, 1e-6)
    facing = np.maximum(along, 0) * np.maximum(back, 0) / squared
    filled = (facing / (np.pi * squared + sample.area)) @ there[others] * (sample.area * _EVERY)
    counted: Points = there * (filled + _ALONE)
    return counted


def reflected(
    sample: SurfaceSample,
    openness: NDArray[np.bool_],
    prominent: Points,
    directions: Points,
    albedo: Points,
    share: Points,
    sky: Sky,
) -> Reflected:
    """Return the light of a sky and its sun that surfaces reflect, matte and on average.

    Args:
        openness: (N, K) bool, True if nothing hides the sky from a place of the sample.
        prominent: (N,) see `prominence`.
        directions: (K, 3) unit vectors, even over the upper half of the sphere.
        albedo: (M, 3) of the materials.
        share: (M,) of their area that is there: less than 1 where texels are cut away.
    """
    count, level = len(directions), sky.ground
    cosines = sample.normals @ directions.T
    upward = sample.normals[:, 2]
    weight = share[sample.rows] * prominent
    # The integral over the upper half of the sphere is the mean over the directions; in the image's unit, twice that.
    gathered = np.maximum(cosines, 0) * (2 / count)
    near_sun = np.maximum(directions @ sky.sun_direction - _AROUND_SUN, 0)
    sunlit = (
        openness @ (near_sun / max(float(near_sun.sum()), 1e-9)) * np.maximum(sample.normals @ sky.sun_direction, 0)
    )
    direct = (gathered * openness) @ sky.radiance(directions) + sunlit[:, None] * sky.sun
    facing = np.maximum(-cosines, 0) * weight[:, None]
    below = np.maximum(upward, 0) * (sample.points[:, 2] < sample.lowest + _GROUND_BAND) * weight
    hidden, ground, light = np.zeros((count, 3)), np.zeros(3), direct
    for _ in range(_BOUNCES):
        light = direct + (gathered * ~openness) @ hidden + (0.5 - 0.5 * upward)[:, None] * ground
        radiance = albedo[sample.rows] * light
        hidden = facing.T @ radiance / np.maximum(facing.sum(axis=0), 1e-9)[:, None]
        ground = below @ radiance / below.sum() if below.sum() > 0 else level
    walls = (np.abs(upward) < _WALL_SLOPE) * weight
    return Reflected(hidden, ground, walls @ light / max(float(walls.sum()), 1e-9))


def sky_weights(sky: Sky, directions: Points, hidden: Points, ground: Points) -> tuple[Points, Points]:
    """Return the spherical harmonics that ``skylight.frag`` sums over K directions above the horizon.

    The basis has orders 0 and 1 and the zonal function of order 2. A street's sky stands above it, so with order 1 alone level
    ground would miss up to a quarter of its light. In a direction in which the sky is hidden, the radiance is that of the hiding
    surfaces. The lower hemisphere is the ground, which contributes nothing of order 2.

    Args:
        directions, hidden, ground: as in `reflected`.

    Returns:
        (4, 4): the sums where nothing is open, and (K, 4, 4): what is added per 1/255 of openness. Three rows for red, green and
        blue, each with the mean and the parts along x, y and z; a row with the three's zonal part of order 2, and 0.
    """
    count = len(directions)
    light = sky.radiance(directions)
    # The upper half of the sphere is the mean over the directions.
    share = 0.5 / count
    basis = np.column_stack([np.ones(count), 3 * directions]) * share
    zonal = (2.5 * (3 * directions[:, 2] ** 2 - 1) * share)[:, None]

    def parts(radiance: Points) -> Points:
        second = np.column_stack([radiance * zonal, np.zeros(count)])
        return np.concatenate([radiance[:, :, None] * basis[:, None], second[:, None]], axis=1)

    sums = parts(hidden).sum(axis=0)
    sums[:3] += from_below(ground)
    return sums, parts(light - hidden) / 255


def from_below(radiance: Points) -> Points:
    """Return the spherical harmonics, (3, 4), as in `sky_weights`, of ground of this radiance, (3,)."""
    sums: Points = radiance[:, None] * np.array([0.5, 0, 0, -0.75])
    return sums
