"""Lens distortion: one map for image and ground truth, which keeps labels aligned with the image.

The model is Brown–Conrady's with OpenCV's names and units. Let x, y be a ray's ideal (pinhole) direction divided by its depth,
and r² = x² + y². The lens maps the ray to ::

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y

so that the coefficients of a calibration at the camera's focal length apply unchanged. Sources: D. Brown,
"Close-range camera calibration", Photogrammetric Engineering 37(8), 1971, 855-866; OpenCV, module calib3d.

A lens that moves the image's border inwards would show areas beyond the rendered image. The distorted image is therefore enlarged
about its centre by the smallest factor, `zoom`, at which all of its pixels have been rendered. The factor is 1 if the lens moves
no part of the border inwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.sensing.settings import Distortion

#: Newton steps of the inversion. Each doubles the number of correct digits.
_STEPS: Final = 8
#: Samples along each border; the table of radii has four times as many.
_SAMPLES: Final = 2048
#: Coefficients below this move no pixel of any image.
_NOTHING: Final = 1e-12
#: Usable share of the fold radius.
_BEFORE_FOLD: Final = 0.98

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PixelMap:
    """The source of each pixel of a distorted image in the pinhole image.

    Attributes:
        x, y: (H, W) float64, pixel coordinates in the pinhole image (0 is the centre of its first pixel).
        zoom: enlargement about the centre.
    """

    x: Floats
    y: Floats
    zoom: float

    def nearest(self) -> NDArray[np.intp]:
        """Return the (H, W) flat index of the nearest pixel of the pinhole image."""
        height, width = self.x.shape
        column = np.clip(np.floor(self.x + 0.5), 0, width - 1)
        row = np.clip(np.floor(self.y + 0.5), 0, height - 1)
        flat: NDArray[np.intp] = (row * width + column).astype(np.intp)
        return flat


@lru_cache(maxsize=4)  # 16 bytes for each pixel
def pixel_map(distortion: Distortion, width: int, height: int, focal_px: float) -> PixelMap:
    """Return the map of a whole image.

    Args:
        distortion: coefficients.
        width, height: pixels; the principal point is the image's centre.
        focal_px: focal length in pixels.
    """
    half_x, half_y = 0.5 * (width - 1), 0.5 * (height - 1)
    zoom = _zoom(distortion, half_x / focal_px, half_y / focal_px)
    ideal_x, ideal_y = undistort(distortion, *directions(width, height, focal_px * zoom))
    source = (ideal_x * focal_px + half_x, ideal_y * focal_px + half_y)
    for array in source:
        array.setflags(write=False)
    return PixelMap(*source, zoom)


def shown_within(distortion: Distortion, width: int, height: int, focal_px: float, zoom: float) -> NDArray[np.bool_]:
    """Return a mask, (H, W) bool, of the pixels of the pinhole image that the distorted image shows.

    Args:
        distortion, width, height, focal_px: as for `pixel_map`.
        zoom: enlargement of that map.
    """
    half_x, half_y = 0.5 * (width - 1), 0.5 * (height - 1)
    x, y = directions(width, height, focal_px)
    lens_x, lens_y = distort(distortion, x, y)
    scale = focal_px * zoom
    inside: NDArray[np.bool_] = (np.abs(lens_x) * scale <= half_x + 0.5) & (np.abs(lens_y) * scale <= half_y + 0.5)
    # Beyond the fold the model moves rays back inwards, which no real lens does.
    inside &= x * x + y * y <= fold_radius(distortion) ** 2
    return inside


def directions(width: int, height: int, focal_px: float) -> tuple[Floats, Floats]:
    """Return the directions of all pixels of a pinhole image, x / z and y / z, (H, W) each."""
    x, y = ((np.arange(size) - 0.5 * (size - 1)) / focal_px for size in (width, height))
    return np.broadcast_to(x, (height, width)), np.broadcast_to(y[:, None], (height, width))


def distort(distortion: Distortion, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the distorted directions of ideal ones, of any shape."""
    d = distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3))
    return (
        x * radial + 2.0 * d.p1 * x * y + d.p2 * (r2 + 2.0 * x * x),
        y * radial + d.p1 * (r2 + 2.0 * y * y) + 2.0 * d.p2 * x * y,
    )


def undistort(distortion: Distortion, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return the ideal directions, within the fold radius, of distorted ones of any shape.

    Newton's method on both coordinates. It starts from the inverse of the radial part alone, interpolated in a table.
    """
    d = distortion
    distorted = np.hypot(x, y)
    ideal_radii = _ideal_radii(d, float(np.max(distorted, initial=0.0)))
    r2 = ideal_radii**2
    distorted_radii = ideal_radii * (1.0 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3)))
    radius = np.interp(distorted, distorted_radii, ideal_radii)
    start = np.where(distorted > 0.0, radius / np.maximum(distorted, 1e-300), 1.0)
    u, v = x * start, y * start
    for _ in range(_STEPS):
        r2 = u * u + v * v
        radial = 1.0 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3))
        slope = d.k1 + r2 * (2.0 * d.k2 + 3.0 * d.k3 * r2)
        error_x = u * radial + 2.0 * d.p1 * u * v + d.p2 * (r2 + 2.0 * u * u) - x
        error_y = v * radial + d.p1 * (r2 + 2.0 * v * v) + 2.0 * d.p2 * u * v - y
        xx = radial + 2.0 * u * u * slope + 2.0 * d.p1 * v + 6.0 * d.p2 * u
        yy = radial + 2.0 * v * v * slope + 6.0 * d.p1 * v + 2.0 * d.p2 * u
        xy = 2.0 * u * v * slope + 2.0 * d.p1 * u + 2.0 * d.p2 * v
        determinant = xx * yy - xy * xy
        u = u - (error_x * yy - error_y * xy) / determinant
        v = v - (error_y * xx - error_x * xy) / determinant
        if float(np.max(np.abs(error_x), initial=0.0) + np.max(np.abs(error_y), initial=0.0)) < 1e-13:
            break
    return u, v


def fold_radius(distortion: Distortion) -> float:
    """Return an ideal radius up to which no two rays meet; infinite if none do.

    Without p1 and p2 it is the radius up to which the distorted radius increases. The Jacobian of the map is symmetric. That of
    the radial part has the eigenvalues d/dr (r R) and R, with R = 1 + k1 r² + k2 r⁴ + k3 r⁶; that of the rest has a norm of at
    most 6 |p| r. While both eigenvalues exceed it, the map is the gradient of a convex function, and so one-to-one.
    """
    d, tangential = distortion, 6.0 * float(np.hypot(distortion.p1, distortion.p2))
    radii = [_first_root([1.0, -tangential, 3.0 * d.k1, 0.0, 5.0 * d.k2, 0.0, 7.0 * d.k3])]
    if tangential > _NOTHING:
        radii.append(_first_root([1.0, -tangential, d.k1, 0.0, d.k2, 0.0, d.k3]))
    return min(radii)


def _first_root(coefficients: Sequence[float]) -> float:
    """Return the smallest positive root of a polynomial, lowest power first; infinite if there is none."""
    roots = np.roots([c if abs(c) > _NOTHING else 0.0 for c in reversed(coefficients)])
    real = roots.real[(np.abs(roots.imag) < 1e-9 * np.maximum(np.abs(roots.real), 1.0)) & (roots.real > 0)]
    return float(real.min()) if real.size else float("inf")


def _ideal_radii(distortion: Distortion, limit: float) -> Floats:
    """Return ideal radii from 0 until the distorted radius reaches ``limit``, or to the fold."""
    d, fold, reach = distortion, fold_radius(distortion), 1.0
    while reach < min(fold, 1e6) and reach * (1.0 + reach**2 * (d.k1 + reach**2 * (d.k2 + reach**2 * d.k3))) < limit:
        reach *= 2.0
    return np.linspace(0.0, min(reach, fold), 4 * _SAMPLES)


def _zoom(distortion: Distortion, half_x: float, half_y: float) -> float:
    """Return the smallest enlargement, at least 1, at which the distorted image shows nothing beyond the rendered border."""
    if distortion.identity:
        return 1.0
    along = np.linspace(-1.0, 1.0, _SAMPLES + 1)
    x = np.concatenate([along, along, np.full_like(along, -1.0), np.full_like(along, 1.0)]) * half_x
    y = np.concatenate([np.full_like(along, -1.0), np.full_like(along, 1.0), along, along]) * half_y
    within = np.minimum(1.0, _BEFORE_FOLD * fold_radius(distortion) / np.hypot(x, y))
    lens_x, lens_y = distort(distortion, x * within, y * within)
    # A rectangle around the centre lies inside a closed curve if no point of the curve lies inside the rectangle.
    reach = float(np.min(np.maximum(np.abs(lens_x) / half_x, np.abs(lens_y) / half_y)))
    return max(1.0, 1.0 / reach)
