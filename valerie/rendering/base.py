"""What a render engine is: a scene and a view in, a linear image out; and the arrays that rendering hands on.

Engines return *only* the scene-referred linear image. Ground truth is one product of the raster truth pass
(`valerie.rendering.ground_truth`) for all engines, keyed by geometry, camera and resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from valerie.errors import RenderingError
from valerie.scene.graph.model import Scene, freeze


@dataclass(frozen=True, slots=True)
class View:
    """Which camera looks, and into how many pixels.

    Attributes:
        camera: name of a camera of the scene, e.g. ``camera-1``.
        width, height: pixels.
    """

    camera: str
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Pixels x … x+width−1, y … y+height−1; the origin is the image's top left. Zero width or height is empty."""

    x: int
    y: int
    width: int
    height: int

    @property
    def empty(self) -> bool:
        return self.width <= 0 or self.height <= 0

    @property
    def slices(self) -> tuple[slice, slice]:
        """(rows, columns) to index an (H, W, …) array."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def clipped(self, width: int, height: int) -> Self:
        """The part inside an image of ``width`` × ``height``."""
        x0, y0 = max(self.x, 0), max(self.y, 0)
        x1, y1 = min(self.x + self.width, width), min(self.y + self.height, height)
        return type(self)(x0, y0, max(x1 - x0, 0), max(y1 - y0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class LinearImage:
    """A scene-referred image.

    Attributes:
        pixels: (H, W, 3) float16, linear Rec. 709 radiance, read-only.
    """

    pixels: NDArray[np.float16]

    def __post_init__(self) -> None:
        freeze(self.pixels)


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """What the movables change in a frame: ``background`` with ``pixels`` put at ``rectangle`` is the frame.

    Attributes:
        rectangle: around all pixels that the movables, their shadows, reflections, ambient occlusion and filters change.
        pixels: (rectangle.height, rectangle.width, 3) float16, linear.
    """

    rectangle: Rectangle
    pixels: NDArray[np.float16]

    def __post_init__(self) -> None:
        freeze(self.pixels)

    def over(self, background: LinearImage) -> LinearImage:
        """The whole frame."""
        if self.rectangle.empty:
            return background
        pixels = background.pixels.copy()
        pixels[self.rectangle.slices] = self.pixels
        return LinearImage(pixels)


class Renderer(Protocol):
    """A render engine; one instance per process, since it may own a GL context.

    Contract (`valerie.testing.RendererContract`): deterministic bytes for equal input in one numeric class;
    ``layer(s, v).over(background(s, v))`` equals ``full(s, v)`` bit for bit in deterministic engines; ``background`` does not
    depend on anything movable; a black or constant image raises `RenderingError`. A path tracer, in which light reaches
    everywhere, keeps the second only up to its noise, and its contract test says so (`RendererContract.noisy`).

    An engine declares its settings and abilities in a `valerie.rendering.engine.Engine`, and is made with the settings where it
    has any. One that computes in another process has a property ``cpu_seconds_elsewhere``: CPU seconds used there so far.
    """

    #: Name in specs and URLs.
    name: ClassVar[str]
    #: Raised by hand whenever the engine's pixels change; part of every product's digest.
    revision: ClassVar[int]

    @property
    def numeric_class(self) -> str:
        """What may change the pixels besides the revision: driver, vendor, precision; e.g. ``llvmpipe-mesa-22.3.6``."""
        ...

    def background(self, scene: Scene, view: View) -> LinearImage:
        """The frame without movables."""
        ...

    def layer(self, scene: Scene, view: View) -> Layer:
        """The part of the frame that the movables change."""
        ...

    def full(self, scene: Scene, view: View) -> LinearImage:
        """The frame from scratch: the oracle of ``background`` and ``layer``."""
        ...

    def close(self) -> None:
        """Free the context; the instance is unusable afterwards."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PersonTruth:
    """The pixels of one person, seen and unseen.

    Attributes:
        instance_id: label id × 1000 + n.
        box: around the person's pixels when it is rendered alone, within the image; empty at the origin when there are none.
        mask: (box.height, box.width) bool, read-only: which pixels of the box these are.
        padded_pixels: their count on a canvas padded beyond the image border (for truncation).
        size: (height, width) of the image.
    """

    instance_id: int
    box: Rectangle
    mask: NDArray[np.bool_]
    padded_pixels: int
    size: tuple[int, int]

    def __post_init__(self) -> None:
        freeze(self.mask)

    @classmethod
    def of(cls, instance_id: int, amodal: NDArray[np.bool_], padded_pixels: int) -> Self:
        """From a mask of the whole image, (H, W) bool."""
        box = bounds(amodal)
        height, width = amodal.shape
        return cls(instance_id, box, amodal[box.slices].copy(), padded_pixels, (height, width))

    @property
    def amodal(self) -> NDArray[np.bool_]:
        """(H, W) bool, read-only: pixels of the person rendered alone, within the image. Made anew at each call."""
        whole = np.zeros(self.size, np.bool_)
        whole[self.box.slices] = self.mask
        return freeze(whole)


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """Pixel-exact truth of one geometry seen by one camera; labels are point samples at pixel centres. Arrays are read-only.

    Attributes:
        class_map: (H, W) uint8 label ids; sky is 23.
        instance_map: (H, W) uint16 instance ids; 0 where the class has no instances.
        depth: (H, W) float32 metres along the optical axis; inf where nothing is hit.
        persons: one entry per person present in the scene, visible or not, by ascending instance id.
    """

    class_map: NDArray[np.uint8]
    instance_map: NDArray[np.uint16]
    depth: NDArray[np.float32]
    persons: tuple[PersonTruth, ...]

    def __post_init__(self) -> None:
        for array in (self.class_map, self.instance_map, self.depth):
            freeze(array)


@dataclass(frozen=True, slots=True, eq=False)
class TruthLayer:
    """What the movables change in the truth of the statics, as `Layer` is for images. Arrays are read-only.

    Attributes:
        rectangle: around the pixels whose class, instance or depth the movables change; empty when there are none.
        changed: (rectangle.height, rectangle.width) bool, which pixels these are, N of them.
        classes: (N,) uint8, instances: (N,) uint16, depths: (N,) float32, of the changed pixels in the order of rows.
        persons: all persons of the scene, those that stand still too.
        size: (height, width) of the image.
    """

    rectangle: Rectangle
    changed: NDArray[np.bool_]
    classes: NDArray[np.uint8]
    instances: NDArray[np.uint16]
    depths: NDArray[np.float32]
    persons: tuple[PersonTruth, ...]
    size: tuple[int, int]

    def __post_init__(self) -> None:
        for array in (self.changed, self.classes, self.instances, self.depths):
            freeze(array)

    def over(self, statics: GroundTruth) -> GroundTruth:
        """The whole truth; ``statics`` is that of the scene without its movables."""
        if self.rectangle.empty:
            return GroundTruth(statics.class_map, statics.instance_map, statics.depth, self.persons)
        classes, instances, depth = statics.class_map.copy(), statics.instance_map.copy(), statics.depth.copy()
        inside = self.rectangle.slices
        classes[inside][self.changed] = self.classes
        instances[inside][self.changed] = self.instances
        depth[inside][self.changed] = self.depths
        return GroundTruth(classes, instances, depth, self.persons)


def bounds(mask: NDArray[np.bool_]) -> Rectangle:
    """The smallest rectangle around all true pixels; empty at the origin when there is none."""
    rows = np.flatnonzero(mask.any(axis=1))
    if not rows.size:
        return Rectangle(0, 0, 0, 0)
    y, height = int(rows[0]), int(rows[-1] - rows[0] + 1)
    columns = np.flatnonzero(mask[y : y + height].any(axis=0))
    return Rectangle(int(columns[0]), y, int(columns[-1] - columns[0] + 1), height)


def require_image(pixels: NDArray[np.float16], *, engine: str) -> None:
    """Refuse an image that no real scene gives.

    Raises:
        RenderingError: not finite, black or constant.
    """
    sample = pixels[::7, ::7].astype(np.float32)
    if not np.isfinite(sample).all():
        raise RenderingError(f"{engine}: the image holds values that are not finite")
    # Exactly: by night, light may differ by less than any step of the day's.
    if float(sample.max()) == float(sample.min()):
        raise RenderingError(f"{engine}: the image is constant (every sampled pixel is {float(sample.flat[0]):.6g})")
