"""Which annotations there are; needs no graphics library."""

from __future__ import annotations

from enum import StrEnum


class AnnotationKind(StrEnum):
    """Truth of a frame that is made only when a spec asks for it; each is a product of its own."""

    #: The direction of the surface in every pixel.
    NORMALS = "normals"
    #: Place, size and heading of every instance in the world and before the camera, and its rectangles in the image.
    BOXES = "boxes"
    #: Of every person with a skeleton the joints in the world, before the camera and in the image, and what is seen of them.
    JOINTS = "joints"
    #: Of every person the light that arrives on the body, its share in shadow and its contrast: columns, no arrays.
    LIGHT = "light"

    @property
    def stored(self) -> bool:
        """Whether it has an object in the store; one that has none is rows of the database."""
        return self is not AnnotationKind.LIGHT

    #: Where what is seen in every pixel is seen in the next frame of the sequence.
    FLOW = "flow"
    #: How fast what is seen in every pixel moves across the image.
    VELOCITY = "velocity"
