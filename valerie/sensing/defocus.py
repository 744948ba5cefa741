"""Defocus: a thin lens images a point outside its focal plane as a disc.

For a lens of focal length f and f-number N, focused at S, the circle of confusion of a point at depth d has the diameter
``f² / (N (S − f)) · |d − S| / d`` on the sensor. Source: M. Born and E. Wolf, Principles of Optics, 7th edition,
1999, section 4.4 (thin lens); M. Potmesil and I. Chakravarty, "Synthetic image generation with a lens and aperture camera
model", ACM TOG 1(2), 1982, doi:10.1145/357299.357300.

The image is split into layers of similar blur. From far to near, each layer is blurred with its own disc and composited over the
layers behind it. The blur of a near object thus spreads over the background, and never the other way. Background that a blurred
edge uncovers is filled in from the pixels around it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Radius below which discs count as points, pixels.
_SHARP: Final = 0.5
#: Ratio of the disc radii of neighbouring layers.
_STEP: Final = 1.35
#: Largest radius, as a share of the image's width.
_LARGEST: Final = 0.03

Floats = NDArray[np.float32]


def circle_of_confusion(
    depth: Floats, *, focal_length_mm: float, focal_px: float, f_number: float, focus_distance_m: float
) -> Floats:
    """Return the signed radius of the circle of confusion, pixels; negative in front of the focal plane.

    Args:
        depth: any shape, metres along the optical axis; inf for the sky.
        focal_length_mm, focal_px: the focal length in millimetres and in pixels.
        f_number: ratio of focal length to aperture diameter.
        focus_distance_m: depth of the focal plane; values below two focal lengths count as two.
    """
    focus = max(1000.0 * focus_distance_m, 2.0 * focal_length_mm)
    at_infinity = 0.5 * focal_length_mm / f_number * focal_px / (focus - focal_length_mm)
    with np.errstate(divide="ignore"):
        nearness = np.float32(focus / 1000.0) / np.maximum(depth, np.float32(1e-3))
    radius: Floats = (np.float32(at_infinity) * (np.float32(1.0) - nearness)).astype(np.float32)
    return radius


def defocus(linear: Floats, radius: Floats) -> Floats:
    """Blur each pixel with its disc.

    Args:
        linear: (H, W, 3), linear light.
        radius: (H, W), pixels, from `circle_of_confusion`; limited to 3 % of the image's width.

    Returns:
        (H, W, 3); the input array itself if the whole image is sharp.
    """
    layers = _layers(radius, _LARGEST * linear.shape[1])
    if len(layers) == 1 and layers[0][0] < _SHARP:
        return linear
    light = np.zeros((*linear.shape[:2], 4), np.float32)
    for disc, mask in layers:
        _lay_over(light, linear, mask, disc)
    blurred = light[..., :3]
    blurred /= np.maximum(light[..., 3:], np.float32(1e-6))
    return blurred


def _layers(radius: Floats, largest: float) -> list[tuple[float, NDArray[np.bool_]]]:
    """Return disc radius, in pixels, and mask of each layer, from far to near."""
    size: Floats = np.minimum(np.abs(radius), np.float32(largest))
    level = np.where(size < _SHARP, 0, 1 + np.floor(np.log(np.maximum(size, _SHARP) / _SHARP) / np.log(_STEP)))
    signed = (np.where(radius < 0.0, -level, level)).astype(np.int32)
    layers = []
    for number in sorted(np.unique(signed).tolist(), reverse=True):
        mask = signed == number
        layers.append((float(size[mask].mean()) if number else 0.0, mask))
    return layers


def _lay_over(light: Floats, linear: Floats, mask: NDArray[np.bool_], disc: float) -> None:
    """Composite a blurred layer over ``light``, which holds premultiplied colour and coverage, (H, W, 4)."""
    margin = int(np.ceil(disc)) + 1 if disc >= _SHARP else 0
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    height, width = mask.shape
    top, bottom = max(int(rows[0]) - margin, 0), min(int(rows[-1]) + margin + 1, height)
    left, right = max(int(columns[0]) - margin, 0), min(int(columns[-1]) + margin + 1, width)
    box = (slice(top, bottom), slice(left, right))
    layer = np.empty((bottom - top, right - left, 4), np.float32)
    cover = mask[box]
    layer[..., :3] = linear[box] * cover[..., None]
    layer[..., 3] = cover
    if disc >= _SHARP:
        layer = convolve(layer, disc_kernel(disc))
    behind = light[box]
    behind *= np.float32(1.0) - layer[..., 3:]
    behind += layer


def disc_kernel(radius: float) -> Floats:
    """Return a disc with a soft rim one pixel wide, (2n + 1, 2n + 1) float32, that sums to 1."""
    reach = int(np.ceil(radius))
    place = np.arange(-reach, reach + 1)
    distance = np.hypot(place[:, None], place[None, :])
    kernel = np.clip(radius + 0.5 - distance, 0.0, 1.0)
    normalized: Floats = (kernel / kernel.sum()).astype(np.float32)
    return normalized


def convolve(image: Floats, kernel: Floats) -> Floats:
    """Convolve an (H, W, C) image with a kernel of odd size, zero-padded. The result is clipped at 0 from below."""
    from scipy import fft

    height, width = image.shape[:2]
    reach = kernel.shape[0] // 2
    shape = [fft.next_fast_len(n + reach, real=True) for n in (height, width)]
    spectrum = fft.rfft2(image, s=shape, axes=(0, 1))
    # With the kernel's centre at the origin, the result needs no shift.
    centred = np.zeros(shape, np.float32)
    centred[: kernel.shape[0], : kernel.shape[1]] = kernel
    centred = np.roll(centred, (-reach, -reach), axis=(0, 1))
    spectrum *= fft.rfft2(centred)[..., None]
    blurred: Floats = fft.irfft2(spectrum, s=shape, axes=(0, 1))[:height, :width].astype(np.float32, copy=False)
    return np.maximum(blurred, np.float32(0.0), out=blurred)
