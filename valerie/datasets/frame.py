"""One labelled frame of a data set, as arrays and a name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from valerie.datasets.camera import CameraDocument
from valerie.errors import InvalidInput
from valerie.labels import BY_ID, VOID
from valerie.measures import Measures
from valerie.spelling import plain_name

#: A part of a name. Underscores separate the parts.
_PART = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")


@dataclass(frozen=True, slots=True, order=True)
class FrameName:
    """The name of a frame as in Cityscapes: ``<city>_<sequence>_<frame>``.

    Attributes:
        city: recording place; for exported runs the run's name and the camera.
        sequence: six digits or more; for exported runs the variant.
        frame: six digits or more; for exported runs the time index.

    Raises:
        InvalidInput: a part is empty or contains other characters than letters, digits and hyphens.
    """

    city: str
    sequence: str
    frame: str

    def __post_init__(self) -> None:
        for part in (self.city, self.sequence, self.frame):
            if not _PART.fullmatch(part):
                raise InvalidInput("not a part of a frame's name", value=part, limit="letters, digits and hyphens")

    @classmethod
    def of(cls, city: str, sequence: int, frame: int) -> Self:
        """Return a name from a city, reduced to letters, digits and hyphens, and two numbers."""
        return cls(plain_name(city) or "valerie", f"{sequence:06}", f"{frame:06}")

    @classmethod
    def parse(cls, stem: str) -> Self:
        """Read the name in a file name with all its suffixes: ``aachen_000000_000019_leftImg8bit.png``.

        Raises:
            InvalidInput: the file name does not begin with such a name.
        """
        parts = stem.split("_")
        if len(parts) < 3:
            raise InvalidInput("not a file name of Cityscapes", value=stem, limit="city_sequence_frame_…")
        return cls(parts[0], parts[1], parts[2].partition(".")[0])

    def __str__(self) -> str:
        return f"{self.city}_{self.sequence}_{self.frame}"


class KeyPoints(TypedDict):
    """COCO's key points of one person.

    Attributes:
        keypoints: x, y and flag of each joint, one after the other.
        num_keypoints: number of joints in the image.
    """

    keypoints: list[float]
    num_keypoints: int


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """One picture with its exact truth.

    Attributes:
        name: unique within a split.
        picture: (H, W, 3) uint8 sRGB.
        class_map: (H, W) uint8 Cityscapes label ids.
        instance_map: (H, W) uint16, label id × 1000 + n; 0 where there is no instance.
        camera: Cityscapes' camera document; None if unknown.
        amodal: instance id to (H, W) bool, all pixels of the person rendered alone, within the image.
        persons: instance id to measures of the person (occlusion, distance …), for formats that hold them.
        key_points: instance id to the person's joints, likewise.

    Raises:
        InvalidInput: shapes or types differ from these.
    """

    name: FrameName
    picture: NDArray[np.uint8]
    class_map: NDArray[np.uint8]
    instance_map: NDArray[np.uint16]
    camera: CameraDocument | None = None
    amodal: Mapping[int, NDArray[np.bool_]] = field(default_factory=lambda: MappingProxyType({}))
    persons: Mapping[int, Measures] = field(default_factory=lambda: MappingProxyType({}))
    key_points: Mapping[int, KeyPoints] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def segment_ids(self) -> NDArray[np.uint16]:
        """Cityscapes' instance ids, (H, W): label id × 1000 + n, and the label id itself where there is no instance."""
        return np.where(self.instance_map > 0, self.instance_map, self.class_map.astype(np.uint16))

    def __post_init__(self) -> None:
        shape = self.class_map.shape
        right = self.picture.dtype == self.class_map.dtype == np.uint8 and self.instance_map.dtype == np.uint16
        if not right or len(shape) != 2 or self.picture.shape != (*shape, 3) or self.instance_map.shape != shape:
            shapes = f"{self.picture.dtype} {self.picture.shape}, {self.class_map.dtype} {shape}, "
            shapes += f"{self.instance_map.dtype} {self.instance_map.shape}"
            raise InvalidInput(
                "picture and labels do not fit", field=str(self.name), value=shapes, limit="uint8, uint8 and uint16"
            )
        for number, mask in self.amodal.items():
            if mask.shape != shape:
                raise InvalidInput(f"the amodal mask of {number} has another shape", field=str(self.name))


def require_label_ids(class_map: NDArray[np.uint8], *, field: str) -> None:
    """Refuse a map with values that are not label ids; 255 is a license plate (id −1) and is ignored.

    Raises:
        InvalidInput: an id is unknown; the message names the first.
    """
    present = np.flatnonzero(np.bincount(class_map.ravel(), minlength=256))
    for number in present.tolist():
        if number not in BY_ID and number != VOID:
            raise InvalidInput(
                "not a label id of Cityscapes", field=field, value=number, limit="0…33, or 255 (ignored)"
            )
