"""The kinds of pictures that people see of a frame."""

from __future__ import annotations

from enum import StrEnum
from typing import Final, Self

from valerie.errors import UnknownName
from valerie.rendering.annotations.kinds import AnnotationKind


class PictureKind(StrEnum):
    """A way to show a frame."""

    #: The output of the sensor stage, which functions see.
    PICTURE = "picture"
    #: The classes of the ground truth, alone and over the picture.
    TRUTH = "truth"
    TRUTH_OVERLAY = "truth-overlay"
    #: Every instance in a colour of its own.
    INSTANCES = "instances"
    #: Near is bright.
    DEPTH = "depth"
    #: The classes that a function predicts, alone and over the picture.
    PREDICTION = "prediction"
    OVERLAY = "overlay"
    #: Hits, misses and false alarms of persons, over the picture.
    ERRORS = "errors"
    #: An annotation; a scan shows in the picture of its sensor.
    NORMALS = AnnotationKind.NORMALS.value
    BOXES = AnnotationKind.BOXES.value
    JOINTS = AnnotationKind.JOINTS.value
    FLOW = AnnotationKind.FLOW.value
    VELOCITY = AnnotationKind.VELOCITY.value

    @classmethod
    def parse(cls, name: str) -> Self:
        """Return a kind by its name in URLs.

        Raises:
            UnknownName: no such kind.
        """
        try:
            return cls(name)
        except ValueError:
            raise UnknownName("kind of picture", name, cls, field="kind") from None


#: Kinds that every frame has, and those that show a prediction.
FRAME_KINDS: Final = (
    PictureKind.PICTURE,
    PictureKind.TRUTH,
    PictureKind.TRUTH_OVERLAY,
    PictureKind.INSTANCES,
    PictureKind.DEPTH,
)
FUNCTION_KINDS: Final = (PictureKind.PREDICTION, PictureKind.OVERLAY, PictureKind.ERRORS)
#: Kinds that a frame has where its run requests the annotation.
ANNOTATION_KINDS: Final = tuple(kind for kind in PictureKind if kind not in FRAME_KINDS + FUNCTION_KINDS)
