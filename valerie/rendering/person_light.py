"""How light falls on each person and how the person stands out from what is around it in the image. Pure numpy and SciPy.

A change of what is measured raises the revision of the annotation (`valerie.runs.inputs`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from valerie.rendering.base import GroundTruth, LinearImage, Rectangle, View, bounds
from valerie.scene.graph.model import Scene

#: Weights of linear Rec. 709 in luminance (ITU-R BT.709-6).
_LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722], np.float32)
#: The ring's width as a share of the square root of the visible area, and its least width.
_RING_SHARE, _RING_LEAST = 0.2, 2
#: Pixels between person and ring: those that antialiasing mixes.
_GAP: Final = 1
#: A sample of light belongs to a pixel of the truth if their depths agree to this: metres, and share of the depth.
_DEPTH_SLACK_M, _DEPTH_SLACK = 0.05, 0.005


@dataclass(frozen=True, slots=True)
class PersonLight:
    """One person in one frame; None where nothing of the person is seen, and what else is said.

    Attributes:
        instance_id: label id × 1000 + n.
        irradiance: mean over the visible pixels of the light that arrives on the surface there, before any material: of the sun
            where it is seen, of the sky and of what reflects into the place, on the surface's own slope. Luminance-weighted; 1 is
            what a surface that faces a sun of irradiance 1 gets from it (a clear noon).
        shadow_share: share of the visible pixels on which less than half of the sun's disc shines: behind something, or turned
            away from it, 0 … 1. None without a sun: below the horizon, or wholly behind clouds.
        contrast: Michelson contrast (B − R) / (B + R) of the mean luminances of the person's visible pixels (B) and of the ring
            around them (R) in the linear image, −1 … 1; negative for a person darker than its surroundings. None where both are
            black or nothing of a ring lies in the image.
    """

    instance_id: int
    irradiance: float | None
    shadow_share: float | None
    contrast: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """Light that arrives on what is seen in a rectangle of the image, one sample per pixel.

    Attributes:
        rectangle: of the image.
        samples: (height, width, 4) float32: luminance of the sun's light and of all other light on the surface, in the image's
            unit; share of the sun's disc that shines on it; its depth in metres, 0 where nothing is hit.
        unit: image value of a white matte surface that faces a sun of irradiance 1.
        sunny: whether there is a sun at all.
    """

    rectangle: Rectangle
    samples: NDArray[np.float32]
    unit: float
    sunny: bool


@runtime_checkable
class LightPass(Protocol):
    """Knows what light arrives where."""

    def received(self, scene: Scene, view: View, rectangles: Sequence[Rectangle]) -> list[Received]:
        """Light on what is seen in each of ``rectangles``, which lie in the image and are not empty."""
        ...


def measure_light(
    truth: GroundTruth, image: LinearImage, scene: Scene, view: View, light: LightPass
) -> tuple[PersonLight, ...]:
    """Light and contrast of every person who is drawn, by ascending instance id.

    Args:
        truth: of this scene and view: which pixels are whose.
        image: the whole frame, by whichever engine.
        scene, view: whose light is measured.
        light: measures it.
    """
    luminance = image.pixels.astype(np.float32) @ _LUMINANCE
    boxes = {person.instance_id: bounds(truth.instance_map == person.instance_id) for person in truth.persons}
    seen = {number: box for number, box in boxes.items() if not box.empty}
    received = dict(zip(seen, light.received(scene, view, list(seen.values())), strict=True)) if seen else {}
    return tuple(_one(number, seen.get(number), truth, luminance, received) for number in boxes)


def _one(
    number: int,
    box: Rectangle | None,
    truth: GroundTruth,
    luminance: NDArray[np.float32],
    received: Mapping[int, Received],
) -> PersonLight:
    if box is None:
        return PersonLight(number, None, None, None)
    here = received[number]
    visible = truth.instance_map[box.slices] == number
    depth = truth.depth[box.slices]
    # At an edge the sample may lie on something else than the pixel's centre.
    slack = _DEPTH_SLACK_M + _DEPTH_SLACK * np.where(np.isfinite(depth), depth, 0.0)
    usable = visible & (np.abs(here.samples[..., 3] - depth) <= slack)
    contrast = ring_contrast(luminance, truth.instance_map == number, box)
    if not usable.any():
        return PersonLight(number, None, None, contrast)
    samples = here.samples[usable].astype(np.float64)
    return PersonLight(
        instance_id=number,
        irradiance=float((samples[:, 0] + samples[:, 1]).mean() / here.unit),
        shadow_share=float((samples[:, 2] < 0.5).mean()) if here.sunny else None,
        contrast=contrast,
    )


def ring_contrast(luminance: NDArray[np.float32], mask: NDArray[np.bool_], box: Rectangle) -> float | None:
    """Michelson contrast of a masked body against the ring around it; see `PersonLight.contrast`.

    The ring is everything in the image between 1 and 1 + w pixels from the body (square neighbourhoods), with w a fifth of the
    square root of the body's pixels, at least 2.

    Args:
        luminance: (H, W), linear.
        mask: (H, W), the body's visible pixels.
        box: around them.
    """
    height, width = mask.shape
    ring = ring_width(int(np.count_nonzero(mask[box.slices])))
    reach = ring + _GAP
    around = Rectangle(box.x - reach, box.y - reach, box.width + 2 * reach, box.height + 2 * reach)
    part = around.clipped(width, height).slices
    body = mask[part]
    near = ndimage.maximum_filter(body, 2 * _GAP + 1)
    far = ndimage.maximum_filter(body, 2 * reach + 1)
    outside = far & ~near
    if not outside.any():
        return None
    inner, outer = (
        float(luminance[part][body].mean(dtype=np.float64)),
        float(luminance[part][outside].mean(dtype=np.float64)),
    )
    return (inner - outer) / (inner + outer) if inner + outer > 0 else None


def ring_width(pixels: int) -> int:
    """Width in pixels of the ring around a body of so many visible pixels."""
    return max(_RING_LEAST, round(_RING_SHARE * math.sqrt(pixels)))
