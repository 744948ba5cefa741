"""The interface of render engines, and the images and ground truth that rendering produces.

An engine turns a scene and a view into a scene-referred linear image, and nothing else. Ground truth comes from the raster
truth pass (`valerie.rendering.ground_truth`) for all engines alike, keyed by geometry, camera and resolution.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from valerie.errors import RenderingError
from valerie.scene.graph.model import Scene, freeze

#: Rows and columns of an image, with positive steps.
Window = tuple[slice, slice]
WHOLE: Final = (slice(None), slice(None))


@dataclass(frozen=True, slots=True)
class View:
    """A camera and the size of its image.

    Attributes:
        camera: name of a camera of the scene, e.g. ``camera-1``.
        width, height: pixels.
    """

    camera: str
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle of pixels: x … x+width−1, y … y+height−1, from the image's top left. Empty if width or height is 0."""

    x: int
    y: int
    width: int
    height: int

    @property
    def empty(self) -> bool:
        return self.width <= 0 or self.height <= 0

    @property
    def slices(self) -> Window:
        """Slices (rows, columns) that index an (H, W, …) array."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def clipped(self, width: int, height: int) -> Self:
        """Return the part inside an image of ``width`` × ``height`` pixels."""
        return self.common(type(self)(0, 0, width, height))

    def widened(self, by: int) -> Self:
        """Return the rectangle with ``by`` pixels more on each side."""
        return type(self)(self.x - by, self.y - by, self.width + 2 * by, self.height + 2 * by)

    def common(self, other: Self) -> Self:
        """Return the part inside another rectangle."""
        x0, y0 = max(self.x, other.x), max(self.y, other.y)
        x1, y1 = min(self.x + self.width, other.x + other.width), min(self.y + self.height, other.y + other.height)
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
    """The part of a frame that the movables change. The frame is the background with ``pixels`` pasted at ``rectangle``.

    Attributes:
        rectangle: contains every pixel that movables change directly or by shadow, reflection, ambient occlusion or filters.
        pixels: (rectangle.height, rectangle.width, 3) float16, linear.
    """

    rectangle: Rectangle
    pixels: NDArray[np.float16]

    def __post_init__(self) -> None:
        freeze(self.pixels)

    def over(self, background: LinearImage, window: Window = WHOLE) -> LinearImage:
        """Return the frame, or the part in a window of it: this layer over its background."""
        if self.rectangle.empty:
            return background if window == WHOLE else LinearImage(background.pixels[window])
        pixels = background.pixels[window].copy()
        shape, inside = background.pixels.shape, self.rectangle.slices
        (rows, own_rows), (columns, own_columns) = (_met(window[k], shape[k], inside[k]) for k in (0, 1))
        pixels[rows, columns] = self.pixels[own_rows, own_columns]
        return LinearImage(pixels)


def _met(window: slice, size: int, layer: slice) -> tuple[slice, slice]:
    """Return where rows of a window and of a layer meet, counted in the window and in the layer; likewise for columns.

    Args:
        window: of ``size`` rows.
        layer: rows ``start`` to ``stop - 1``.
    """
    taken = range(size)[window]
    first, end = bisect_left(taken, layer.start), bisect_left(taken, layer.stop)
    start = taken.start + first * taken.step - layer.start
    return slice(first, end), slice(start, start + (end - first) * taken.step, taken.step)


class Renderer(Protocol):
    """A render engine. There is one instance per process, since it may own a GL context.

    `valerie.testing.RendererContract` tests the contract:

    - Equal input gives equal bytes within one numeric class.
    - ``layer(s, v).over(background(s, v))`` equals ``full(s, v)`` bit for bit. A path tracer, in which light reaches everywhere,
      meets this only up to its noise; its contract test sets `RendererContract.noisy`.
    - ``background`` does not depend on movables.
    - A black or constant image raises `RenderingError`.

    - ``part(s, v, w)``, which an engine may have, equals ``full(s, v)`` in the rectangle ``w``: (w.height, w.width, 3) float16. A
      rolling shutter asks for one part per slice of the image (`valerie.rendering.scanning`). For an engine without ``part``,
      it renders whole frames.

    A `valerie.rendering.engine.Engine` declares the engine's settings and abilities. An engine with settings takes them as its
    only argument. An engine that computes in another process has a property ``cpu_seconds_elsewhere``: the CPU seconds of that
    process so far.
    """

    #: Name in specs and URLs.
    name: ClassVar[str]
    #: Part of every product's digest. Raise it by hand whenever the engine's pixels change.
    revision: ClassVar[int]

    @property
    def numeric_class(self) -> str:
        """Name of the arithmetic (driver, vendor, precision) that may change the pixels, e.g. ``llvmpipe-mesa-22.3.6``."""
        ...

    def background(self, scene: Scene, view: View) -> LinearImage:
        """Render the frame without movables."""
        ...

    def layer(self, scene: Scene, view: View) -> Layer:
        """Render the part of the frame that the movables change."""
        ...

    def full(self, scene: Scene, view: View) -> LinearImage:
        """Render the whole frame at once: the oracle for ``background`` and ``layer``."""
        ...

    def close(self) -> None:
        """Free the context. The instance is unusable afterwards."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PersonTruth:
    """The amodal mask of one person: its pixels as if nothing hid it.

    Attributes:
        instance_id: label id × 1000 + n.
        box: bounding box, within the image, of the person rendered alone; empty at the origin if it has no pixel.
        mask: (box.height, box.width) bool, read-only; true on the person's pixels.
        padded_pixels: number of the person's pixels on a canvas padded beyond the image border (for truncation).
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
        """Build from a mask of the whole image, ``amodal``, (H, W) bool."""
        box = bounds(amodal)
        height, width = amodal.shape
        return cls(instance_id, box, amodal[box.slices].copy(), padded_pixels, (height, width))

    @property
    def amodal(self) -> NDArray[np.bool_]:
        """Amodal mask of the whole image, (H, W) bool, read-only. A new array at each call."""
        whole = np.zeros(self.size, np.bool_)
        whole[self.box.slices] = self.mask
        return freeze(whole)


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """Pixel-exact ground truth of one geometry and one camera, sampled at pixel centres. Arrays are read-only.

    Attributes:
        class_map: (H, W) uint8 label ids; sky is 23.
        instance_map: (H, W) uint16 instance ids; 0 where the class has no instances.
        depth: (H, W) float32, metres along the optical axis; inf on the sky.
        persons: every person present in the scene, visible or not, by ascending instance id.
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
    """The part of the ground truth that the movables change, as `Layer` is of the image. Arrays are read-only.

    Attributes:
        rectangle: contains the pixels whose class, instance or depth the movables change; empty if there are none.
        changed: (rectangle.height, rectangle.width) bool; true on the N changed pixels.
        classes: (N,) uint8, instances: (N,) uint16, depths: (N,) float32, metres; of the changed pixels, row by row.
        persons: all persons of the scene, static ones too.
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
        """Return the whole ground truth. ``statics`` is the ground truth of the scene without its movables."""
        instances = self._changed(statics.instance_map, self.instances)
        return GroundTruth(
            self.classes_over(statics.class_map), instances, self._changed(statics.depth, self.depths), self.persons
        )

    def classes_over(self, class_map: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the classes alone, (H, W) uint8, over those of the statics."""
        return self._changed(class_map, self.classes)

    def _changed(self, below: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        if self.rectangle.empty:
            return below
        changed = below.copy()
        changed[self.rectangle.slices][self.changed] = values
        return changed


def bounds(mask: NDArray[np.bool_]) -> Rectangle:
    """Return the smallest rectangle around all true pixels of an (H, W) mask; empty at the origin if there are none."""
    rows = np.flatnonzero(mask.any(axis=1))
    if not rows.size:
        return Rectangle(0, 0, 0, 0)
    y, height = int(rows[0]), int(rows[-1] - rows[0] + 1)
    columns = np.flatnonzero(mask[y : y + height].any(axis=0))
    return Rectangle(int(columns[0]), y, int(columns[-1] - columns[0] + 1), height)


def require_image(pixels: NDArray[np.float16], *, engine: str) -> None:
    """Refuse an image that no real scene can produce.

    Raises:
        RenderingError: the image is constant (black, for example) or not finite.
    """
    sample = pixels[::7, ::7].astype(np.float32)
    if not np.isfinite(sample).all():
        raise RenderingError(f"{engine}: the image has values that are not finite")
    # The comparison is exact: at night, pixels may differ by less than any tolerance that suits the day.
    if float(sample.max()) == float(sample.min()):
        raise RenderingError(f"{engine}: the image is constant (every sampled pixel is {float(sample.flat[0]):.6g})")
