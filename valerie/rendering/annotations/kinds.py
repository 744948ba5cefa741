"""The kinds of annotations. Imports no graphics library."""

from __future__ import annotations

from enum import StrEnum


class AnnotationKind(StrEnum):
    """Ground truth that a frame gets only if the spec requests it. Each kind is a product of its own."""

    #: The surface normal at every pixel.
    NORMALS = "normals"
    #: Place, size and heading of every instance in world and camera coordinates, and its rectangles in the image.
    BOXES = "boxes"
    #: Joints of every person with a skeleton, in world, camera and image coordinates, and their visibility.
    JOINTS = "joints"
    #: Irradiance, share in shadow and contrast of every person: database columns, no arrays.
    LIGHT = "light"

    @property
    def stored(self) -> bool:
        """True if the annotation is an object in the store; otherwise it is rows of the database."""
        return self is not AnnotationKind.LIGHT

    #: Optical flow of every pixel to the next frame of the sequence.
    FLOW = "flow"
    #: Image velocity of every pixel.
    VELOCITY = "velocity"
    #: The frame as a rolling shutter reads it: image and truth, line by line.
    SCAN = "scan"
