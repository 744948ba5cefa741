"""Indirect light: an estimate of the light that a scene reflects, from a sample of its surfaces. Uses no GPU.

The sky light of the raster engine (``skylight.frag``) knows in which directions surfaces hide the sky, but not which surfaces. It
uses the mean radiance of all surfaces that face the place, each with its own colour and with the sun and sky that reach it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.projection import Points
from valerie.rendering.sky import SNOW_ALBEDO, Sky
from valerie.rendering.surface_constants import SNOW_SLOPE, SNOW_TAKEN
from valerie.scene.light.weather import COVERING_M

#: Number of sampled places on the statics.
SAMPLE: Final = 4096
#: Tries per triangle to find a place in the scene. A ground plane that reaches to the horizon needs this many.
_TRIES: Final = 128
#: Margin around the scene's core that still counts as scene, metres.
_AROUND: Final = 1.0
#: Height of the band above the lowest point in which upward surfaces are ground, metres. Higher ones may be roofs.
_GROUND_BAND: Final = 2.0
#: Largest upward component of a wall's normal.
_WALL_SLOPE: Final = 0.3
#: Cosine of the radius around the sun within which the visibility of the sky stands for that of the sun.
_AROUND_SUN: Final = np.cos(np.deg2rad(25.0))
#: Step between the places that represent all others.
_EVERY: Final = 16
#: Weight of a place that faces no other.
_ALONE: Final = 0.01
#: Number of bounces. Another bounce would add some percent of the first.
_BOUNCES: Final = 3


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSample:
    """Places on surfaces, each of which represents the same area. A thin sheet has places on both sides.

    Attributes:
        points: (N, 3) positions in the world, metres.
        normals: (N, 3) unit normals of the triangles.
        rows: (N,) rows of their materials.
        lowest: lowest height of the ground, metres.
        area: area that each place represents, m².
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
    """Light that surfaces reflect, linear RGB in the image's unit.

    Attributes:
        hidden: (K, 3) radiance of the surfaces that hide the sky in each direction.
        ground: (3,) radiance of the ground.
        on_walls: (3,) mean light on walls, as the radiance of white walls.
        radiance: (N, 3) radiance of each place of the sample.
    """

    hidden: Points
    ground: Points
    on_walls: Points
    radiance: Points


def sample_surfaces(
    positions: NDArray[np.float32],
    faces: NDArray[np.uint32],
    rows: NDArray[np.uint32],
    two_sided: NDArray[np.bool_],
    low: Points,
    high: Points,
) -> SurfaceSample:
    """Return a sample of the triangles in a box, evenly distributed over their area and the same in every process.

    Args:
        positions: (V, 3) vertices, metres.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        rows: (T,) rows of materials.
        two_sided: (T,) True if the back is visible too.
        low, high: (3,) corners of the box, metres.
    """
    first, second, third = (positions[faces[:, k]] for k in range(3))
    across = np.cross(second - first, third - first)
    double = np.linalg.norm(across, axis=1)
    least, largest = np.minimum(np.minimum(first, second), third), np.maximum(np.maximum(first, second), third)
    low, high = low - _AROUND, high + _AROUND
    # A triangle that crosses the border counts by the share of its bounding box that lies inside.
    inside = np.maximum(np.minimum(largest, high) - np.maximum(least, low), 0)
    touches = ((largest >= low) & (least <= high)).all(axis=1)
    share = np.where(largest > least, inside / np.maximum(largest - least, 1e-9), 1.0).prod(axis=1)
    summed = np.cumsum(double * share * touches, dtype=np.float64)
    if not len(summed) or not summed[-1] > 0:
        return SurfaceSample.empty(float(low[2] + _AROUND))
    triangles = np.searchsorted(summed, (np.arange(SAMPLE) + 0.5) / SAMPLE * summed[-1])
    points = _places(first[triangles], second[triangles], third[triangles], low, high)
    within = ((points >= low) & (points <= high)).all(axis=1)
    points, triangles = points[within], triangles[within]
    normals = across[triangles].astype(np.float64) / double[triangles, None]
    both = two_sided[triangles]
    return SurfaceSample(
        np.concatenate([points, points[both]]),
        np.concatenate([normals, -normals[both]]),
        np.concatenate([rows[triangles], rows[triangles][both]]).astype(np.intp),
        float(low[2] + _AROUND),
        float(summed[-1]) / 2 / SAMPLE,
    )


def _places(first: Points, second: Points, third: Points, low: Points, high: Points) -> Points:
    """Return a place in each triangle, (N, 3), inside the box if one of `_TRIES` candidates is."""
    # Any part of the R₂ sequence is evenly distributed over the unit square (Roberts 2018, "The unreasonable effectiveness of
    # quasirandom sequences").
    count = len(first)
    numbers = np.arange(count * _TRIES).reshape(_TRIES, count)
    points = np.empty((count, 3))
    outside = np.ones(count, np.bool_)
    for number in numbers:
        across, up = (
            (0.5 + number[outside] * 0.7548776662466927) % 1.0,
            (0.5 + number[outside] * 0.5698402909980532) % 1.0,
        )
        over = across + up > 1.0
        across, up = np.where(over, 1 - across, across)[:, None], np.where(over, 1 - up, up)[:, None]
        origin = first[outside].astype(np.float64)
        candidates = origin + (second[outside] - origin) * across + (third[outside] - origin) * up
        points[outside] = candidates
        outside[outside] = ~((candidates >= low) & (candidates <= high)).all(axis=1)
        if not outside.any():
            break
    return points


def prominence(sample: SurfaceSample, openness: NDArray[np.bool_]) -> Points:
    """Return the weight of each place, (N,), in the view of other places.

    Form factors are reciprocal: other places see as much of a place as it sees of them. The weight is therefore the share of a
    place's view that other places fill (form factors of discs, Wallace, Elmquist and Haines 1989, "A ray tracing algorithm for
    progressive radiosity"), estimated from some of them and without occlusion. Walls that face others thus count for more
    than the backs of houses, roofs and surfaces that face outwards. Places without an open direction (in rooms, under the road)
    count for nothing.

    Args:
        openness: as for `reflected`.
    """
    outdoors: NDArray[np.bool_] = np.asarray(openness.any(axis=1))
    points = sample.points - sample.points.mean(axis=0) if len(outdoors) else sample.points
    every = slice(None, None, _EVERY)
    others, normals = points[every], sample.normals[every]
    along = sample.normals @ others.T - (sample.normals * points).sum(axis=1)[:, None]
    back = points @ normals.T - (normals * others).sum(axis=1)
    squared = (points**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2 * points @ others.T
    squared = np.maximum(squared, 1e-6)
    facing = np.maximum(along, 0) * np.maximum(back, 0) / squared
    shares = (facing / (np.pi * squared + sample.area)) @ outdoors[every] * (sample.area * _EVERY)
    weights: Points = outdoors * (shares + _ALONE)
    return weights


def reflected(
    sample: SurfaceSample,
    openness: NDArray[np.bool_],
    prominent: Points,
    directions: Points,
    albedo: Points,
    share: Points,
    sky: Sky,
) -> Reflected:
    """Return the mean light of a sky and its sun that surfaces reflect diffusely.

    Args:
        sample: N places on surfaces.
        openness: (N, K) bool, True if nothing hides the sky from a place of the sample.
        prominent: (N,) weights, see `prominence`.
        directions: (K, 3) unit vectors, evenly distributed over the upper hemisphere.
        albedo: (N, 3) albedo of the places.
        share: (M,) share of the materials' area that is not cut out.
    """
    count, level = len(directions), sky.ground
    cosines = sample.normals @ directions.T
    upward = sample.normals[:, 2]
    weight = share[sample.rows] * prominent
    # In the image's unit, the integral over the upper hemisphere is twice the mean over the directions.
    gather = np.maximum(cosines, 0) * (2 / count)
    near_sun = np.maximum(directions @ sky.sun_direction - _AROUND_SUN, 0)
    sunlit = (
        openness @ (near_sun / max(float(near_sun.sum()), 1e-9)) * np.maximum(sample.normals @ sky.sun_direction, 0)
    )
    direct = (gather * openness) @ sky.radiance(directions) + sunlit[:, None] * sky.sun
    facing = np.maximum(-cosines, 0) * weight[:, None]
    below = np.maximum(upward, 0) * (sample.points[:, 2] < sample.lowest + _GROUND_BAND) * weight
    hidden, ground, light, radiance = np.zeros((count, 3)), np.zeros(3), direct, albedo * direct
    for _ in range(_BOUNCES):
        light = direct + (gather * ~openness) @ hidden + (0.5 - 0.5 * upward)[:, None] * ground
        radiance = albedo * light
        hidden = facing.T @ radiance / np.maximum(facing.sum(axis=0), 1e-9)[:, None]
        ground = below @ radiance / below.sum() if below.sum() > 0 else level
    walls = (np.abs(upward) < _WALL_SLOPE) * weight
    return Reflected(hidden, ground, walls @ light / max(float(walls.sum()), 1e-9), radiance)


def snowed(albedo: Points, upward: Points, traffic: Points, depth: float) -> Points:
    """Return the albedo of places, (N, 3), with ``depth`` metres of lying snow.

    Args:
        albedo: (N, 3) without snow.
        upward: (N,) upward components of the normals.
        traffic: (N,) see `valerie.scene.graph.model.Material`; it leaves a third of the snow on the whole surface.
    """
    if depth <= 0:
        return albedo
    (low, high), (*_, taken) = SNOW_SLOPE, SNOW_TAKEN
    slope = np.clip((upward - low) / (high - low), 0.0, 1.0)
    lying = depth * slope * slope * (3.0 - 2.0 * slope) * (1.0 - taken * traffic)
    covered = np.tanh(lying / COVERING_M)[:, None]
    result: Points = albedo + covered * (SNOW_ALBEDO - albedo)
    return result


def sky_weights(sky: Sky, directions: Points, hidden: Points, ground: Points) -> tuple[Points, Points]:
    """Return the spherical harmonics that ``skylight.frag`` sums over K directions above the horizon.

    The basis has orders 0 and 1 and the zonal function of order 2. Between houses the sky is overhead, so level ground would
    lose up to a quarter of its light with orders 0 and 1 alone. Where surfaces hide the sky, the radiance is theirs. The lower
    hemisphere is the ground, which has no part of order 2.

    Args:
        directions, hidden, ground: as in `reflected`.

    Returns:
        (7, 4) sums if no direction is open, and (K, 7, 4) increments per 1/255 of openness. Three rows hold the mean and the
        parts along x, y and z of red, green and blue; the next row holds their zonal parts of order 2, and 0. The last three are
        moments of the hidden directions: 1, x, y, z; xx, xy, xz, yy; yz, zzx, zzy, zzz.
    """
    count = len(directions)
    light = sky.radiance(directions)
    # The upper hemisphere is half of the sphere.
    share = 0.5 / count
    basis = np.column_stack([np.ones(count), 3 * directions]) * share
    zonal = (2.5 * (3 * directions[:, 2] ** 2 - 1) * share)[:, None]

    x, y, z = directions.T
    products = np.stack([np.ones(count), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z * x, z * z * y, z * z * z])
    moments = share * products.T.reshape(count, 3, 4)

    def parts(radiance: Points) -> Points:
        second = np.column_stack([radiance * zonal, np.zeros(count)])
        return np.concatenate([radiance[:, :, None] * basis[:, None], second[:, None]], axis=1)

    sums = np.concatenate([parts(hidden), moments], axis=1).sum(axis=0)
    sums[:3] += from_below(ground)
    return sums, np.concatenate([parts(light - hidden), -moments], axis=1) / 255


def from_below(radiance: Points) -> Points:
    """Return the spherical harmonics, (3, 4), of ground with a radiance, (3,), in the order of `sky_weights`."""
    sums: Points = radiance[:, None] * np.array([0.5, 0, 0, -0.75])
    return sums
