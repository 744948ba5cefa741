"""The change of a frame, image and truth, when a rolling shutter reads it line by line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from valerie.rendering.base import GroundTruth, LinearImage, PersonTruth, Rectangle


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """The rectangle of a frame that changes when it is read line by line. N persons; arrays are read-only.

    Attributes:
        rectangle: (4,) int64: x, y, width, height.
        pixels: (height, width, 3) float16, linear; ``class_map`` uint8, ``instance_map`` uint16, ``depth`` float32, metres,
            (height, width).
        vectors: (height, width, 2) float32, velocities in pixels per second; (0, 0, 2) if they were not requested.
        instances: (N,) int64, instance ids.
        boxes: (N, 4) int64: x, y, width, height of each whole person in the image.
        padded_pixels: (N,) int64, see `PersonTruth`.
        masks: uint8, 0 or 1, the amodal masks in ``boxes``, one after the other.
        size: (2,) int64: height and width of the image.
    """

    rectangle: NDArray[np.int64]
    pixels: NDArray[np.float16]
    class_map: NDArray[np.uint8]
    instance_map: NDArray[np.uint16]
    depth: NDArray[np.float32]
    vectors: NDArray[np.float32]
    instances: NDArray[np.int64]
    boxes: NDArray[np.int64]
    padded_pixels: NDArray[np.int64]
    masks: NDArray[np.uint8]
    size: NDArray[np.int64]

    def consistent(self) -> bool:
        """Return True if the types and shapes of the arrays are consistent."""
        width, height = self.rectangle[2:].tolist()
        types = {
            "rectangle": (np.int64, (4,)), "pixels": (np.float16, (height, width, 3)),
            "class_map": (np.uint8, (height, width)), "instance_map": (np.uint16, (height, width)),
            "depth": (np.float32, (height, width)), "instances": (np.int64, (len(self.instances),)),
            "boxes": (np.int64, (len(self.instances), 4)), "padded_pixels": (np.int64, (len(self.instances),)),
            "masks": (np.uint8, (int((self.boxes[:, 2] * self.boxes[:, 3]).sum()),)), "size": (np.int64, (2,)),
        }  # fmt: skip
        fit = all(
            getattr(self, name).dtype == kind and getattr(self, name).shape == shape
            for name, (kind, shape) in types.items()
        )
        moves = self.vectors.dtype == np.float32 and self.vectors.shape in ((0, 0, 2), (height, width, 2))
        tall, wide = self.size.tolist()
        inside = all(Rectangle(*box).clipped(wide, tall) == Rectangle(*box) for box in self.boxes.tolist())
        place = Rectangle(*self.rectangle.tolist())
        return fit and moves and inside and place.clipped(wide, tall) == place

    def image(self, frame: LinearImage) -> LinearImage:
        """Return the scanned linear image. ``frame`` is the image without the scan."""
        return LinearImage(self._over(frame.pixels, self.pixels))

    def truth(self, frame: GroundTruth) -> GroundTruth:
        """Return the scanned ground truth. ``frame`` is the truth without the scan."""
        return GroundTruth(
            self._over(frame.class_map, self.class_map),
            self._over(frame.instance_map, self.instance_map),
            self._over(frame.depth, self.depth),
            self.persons,
        )

    @property
    def velocity(self) -> NDArray[np.float32]:
        """The velocities, (H, W, 2) float32; 0 where nothing changes."""
        return self._over(np.zeros((*self.size.tolist(), 2), np.float32), self.vectors)

    @property
    def persons(self) -> tuple[PersonTruth, ...]:
        """The persons of the truth."""
        persons, first, (height, width) = [], 0, self.size.tolist()
        for number, box, padded in zip(
            self.instances.tolist(), self.boxes.tolist(), self.padded_pixels.tolist(), strict=True
        ):
            rectangle = Rectangle(*box)
            last = first + rectangle.width * rectangle.height
            mask = self.masks[first:last].reshape(rectangle.height, rectangle.width).astype(np.bool_)
            persons.append(PersonTruth(number, rectangle, mask, padded, (height, width)))
            first = last
        return tuple(persons)

    def _over(self, below: NDArray, part: NDArray) -> NDArray:  # type: ignore[type-arg]
        if not part.size:
            return below
        whole = below.copy()
        whole[Rectangle(*self.rectangle.tolist()).slices] = part
        return whole
