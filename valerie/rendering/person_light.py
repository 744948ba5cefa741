"""Irradiance, shadow and contrast of each person in an image, without a GPU.

Raise the annotation's revision (`valerie.runs.products.inputs`) whenever a measure changes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from valerie.color import luminance_of
from valerie.rendering.base import GroundTruth, LinearImage, Rectangle, View, bounds
from valerie.scene.graph.model import Scene

#: Width of the ring as a share of the square root of the visible area, and its smallest width in pixels.
_RING_SHARE, _RING_LEAST = 0.2, 2
#: Width of the gap between person and ring, pixels. Antialiasing mixes both there.
_GAP: Final = 1
#: Largest difference in depth between a light sample and the truth at its pixel: metres, plus a share of the depth.
_DEPTH_SLACK_M, _DEPTH_SLACK = 0.05, 0.005


@dataclass(frozen=True, slots=True)
class PersonLight:
    """The light on one person in one frame. All values are None if no pixel of the person is visible.

    Attributes:
        instance_id: label id × 1000 + n.
        irradiance: mean luminance of the light that arrives at the visible pixels from the sun, the sky and the surroundings,
            along the surface normal and before any material. 1 is the sunlight on a surface that faces a sun of irradiance 1 (a
            clear noon).
        shadow_share: share of the visible pixels, 0 … 1, on which less than half of the sun's disc shines, because something
            hides it or the surface faces away. None without a sun: below the horizon, or wholly behind clouds.
        contrast: Michelson contrast (B − R) / (B + R) of the mean luminances of the person's visible pixels (B) and of the ring
            around them (R) in the linear image, −1 … 1; negative for a person darker than its surroundings. None if both are
            black or no pixel of the ring lies in the image.
    """

    instance_id: int
    irradiance: float | None
    shadow_share: float | None
    contrast: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """The light that arrives on the visible surfaces in a rectangle of the image, one sample per pixel.

    Attributes:
        rectangle: pixels of the image.
        samples: (height, width, 4) float32: luminance of sunlight on the surface and of all other light on it, in the image's
            unit; visible share of the sun's disc; depth of the surface in metres, 0 on the sky.
        unit: image value of a white matte surface that faces a sun of irradiance 1.
        sunny: true if there is a sun.
    """

    rectangle: Rectangle
    samples: NDArray[np.float32]
    unit: float
    sunny: bool


@runtime_checkable
class LightPass(Protocol):
    """An engine that can measure the light that arrives on surfaces."""

    def received(self, scene: Scene, view: View, rectangles: Sequence[Rectangle]) -> list[Received]:
        """Return the light in each of ``rectangles``, which lie in the image and are not empty."""
        ...


def measure_light(
    truth: GroundTruth, image: LinearImage, scene: Scene, view: View, light: LightPass
) -> tuple[PersonLight, ...]:
    """Return light and contrast of every person in ``truth``, by ascending instance id.

    Args:
        truth: ground truth of this scene and view.
        image: the whole frame, from any engine.
        scene, view: the scene and the view to measure.
        light: the engine that measures the light.
    """
    luminance = luminance_of(image.pixels.astype(np.float32))
    boxes = {person.instance_id: bounds(truth.instance_map == person.instance_id) for person in truth.persons}
    visible = {number: box for number, box in boxes.items() if not box.empty}
    received = dict(zip(visible, light.received(scene, view, list(visible.values())), strict=True)) if visible else {}
    return tuple(_person(number, visible.get(number), truth, luminance, received) for number in boxes)


def _person(
    number: int,
    box: Rectangle | None,
    truth: GroundTruth,
    luminance: NDArray[np.float32],
    received: Mapping[int, Received],
) -> PersonLight:
    if box is None:
        return PersonLight(number, None, None, None)
    arriving = received[number]
    visible = truth.instance_map[box.slices] == number
    depth = truth.depth[box.slices]
    # At an edge, the light sample and the pixel's centre may lie on different surfaces.
    slack = _DEPTH_SLACK_M + _DEPTH_SLACK * np.where(np.isfinite(depth), depth, 0.0)
    usable = visible & (np.abs(arriving.samples[..., 3] - depth) <= slack)
    contrast = ring_contrast(luminance, truth.instance_map == number, box)
    if not usable.any():
        return PersonLight(number, None, None, contrast)
    samples = arriving.samples[usable].astype(np.float64)
    return PersonLight(
        instance_id=number,
        irradiance=float((samples[:, 0] + samples[:, 1]).mean() / arriving.unit),
        shadow_share=float((samples[:, 2] < 0.5).mean()) if arriving.sunny else None,
        contrast=contrast,
    )


def ring_contrast(luminance: NDArray[np.float32], mask: NDArray[np.bool_], box: Rectangle) -> float | None:
    """Return the Michelson contrast of a body against the ring around it; see `PersonLight.contrast`.

    The ring holds the pixels of the image between 1 and 1 + w pixels from the body (square neighbourhoods). w is a fifth of the
    square root of the number of the body's pixels, at least 2.

    Args:
        luminance: (H, W), linear.
        mask: (H, W) bool, the body's visible pixels.
        box: bounding box of the mask.
    """
    from scipy.ndimage import maximum_filter

    height, width = mask.shape
    ring = ring_width(int(np.count_nonzero(mask[box.slices])))
    reach = ring + _GAP
    around = Rectangle(box.x - reach, box.y - reach, box.width + 2 * reach, box.height + 2 * reach)
    part = around.clipped(width, height).slices
    body = mask[part]
    near = maximum_filter(body, 2 * _GAP + 1)
    far = maximum_filter(body, 2 * reach + 1)
    outside = far & ~near
    if not outside.any():
        return None
    inner, outer = (
        float(luminance[part][body].mean(dtype=np.float64)),
        float(luminance[part][outside].mean(dtype=np.float64)),
    )
    return (inner - outer) / (inner + outer) if inner + outer > 0 else None


def ring_width(pixels: int) -> int:
    """Return the width, in pixels, of the ring around a body of ``pixels`` visible pixels."""
    return max(_RING_LEAST, round(_RING_SHARE * math.sqrt(pixels)))
