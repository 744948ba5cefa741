"""Encode and decode annotations, in the envelope of `valerie.storage.envelope`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.errors import CorruptArtifact
from valerie.rendering.annotations.boxes import Boxes
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.joints import Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.annotations.scan import Scan
from valerie.scene.graph.model import JOINTS
from valerie.storage import envelope

Annotation = Normals | Boxes | FlowMap | Joints | Scan

#: Type of each array of boxes, and its shape after the axis of instances.
_BOXES: Final[dict[str, tuple[type[Any], tuple[int, ...]]]] = {
    "instances": (np.int64, ()),
    "centres": (np.float32, (3,)),
    "sizes": (np.float32, (3,)),
    "headings_deg": (np.float32, ()),
    "camera_centres": (np.float32, (3,)),
    "camera_headings_deg": (np.float32, ()),
    "pixel_areas": (np.int64, ()),
    "visible_boxes": (np.int64, (4,)),
    "projected_boxes": (np.float32, (4,)),
    "corners": (np.float32, (8, 3)),
    "projected_corners": (np.float32, (8, 2)),
}
#: The same for joints.
_JOINTS: Final[dict[str, tuple[type[Any], tuple[int, ...]]]] = {
    "instances": (np.int64, ()),
    "known": (np.uint8, ()),
    "places": (np.float32, (len(JOINTS), 3)),
    "camera_places": (np.float32, (len(JOINTS), 3)),
    "pixels": (np.float32, (len(JOINTS), 2)),
    "visibility": (np.uint8, (len(JOINTS),)),
}


def encode_annotation(kind: AnnotationKind, annotation: Annotation) -> bytes:
    """Pack an annotation's arrays under the names of its fields."""
    arrays = {field.name: getattr(annotation, field.name) for field in fields(annotation)}
    return envelope.pack(kind.value, arrays, {})


def decode_normals(data: bytes) -> Normals:
    """Read normals that `encode_annotation` packed.

    Raises:
        CorruptArtifact: not whole, consistent normals.
    """
    arrays, _ = envelope.unpack(AnnotationKind.NORMALS.value, data)
    normals = arrays.get("octahedral")
    if normals is None or normals.dtype != np.int16 or normals.ndim != 3 or normals.shape[2] != 2:
        raise CorruptArtifact("artifact: the normals are not (height, width, 2) int16")
    return Normals(normals)


def decode_flow(data: bytes, *, kind: AnnotationKind = AnnotationKind.FLOW) -> FlowMap:
    """Read flow or velocity that `encode_annotation` packed.

    Raises:
        CorruptArtifact: not whole, consistent vectors.
    """
    arrays, _ = envelope.unpack(kind.value, data)
    vectors = arrays.get("vectors")
    if vectors is None or vectors.dtype != np.float32 or vectors.ndim != 3 or vectors.shape[2] != 2:
        raise CorruptArtifact(f"artifact: the {kind.value} is not (height, width, 2) float32")
    return FlowMap(vectors)


def decode_boxes(data: bytes) -> Boxes:
    """Read boxes that `encode_annotation` packed.

    Raises:
        CorruptArtifact: not whole, consistent boxes.
    """
    return Boxes(**_rows(AnnotationKind.BOXES, _BOXES, data))


def decode_joints(data: bytes) -> Joints:
    """Read joints that `encode_annotation` packed.

    Raises:
        CorruptArtifact: not whole, consistent joints.
    """
    return Joints(**_rows(AnnotationKind.JOINTS, _JOINTS, data))


def decode_scan(data: bytes) -> Scan:
    """Read a scan that `encode_annotation` packed.

    Raises:
        CorruptArtifact: not a whole, consistent scan.
    """
    arrays, _ = envelope.unpack(AnnotationKind.SCAN.value, data)
    try:
        scan = Scan(**arrays)
        whole = scan.consistent()
    except (TypeError, ValueError, IndexError) as error:
        raise CorruptArtifact(f"artifact: not a scan: {error}") from error
    if not whole:
        raise CorruptArtifact("artifact: the arrays of the scan do not fit together")
    return scan


def _rows(
    kind: AnnotationKind, shapes: Mapping[str, tuple[type[Any], tuple[int, ...]]], data: bytes
) -> dict[str, NDArray[Any]]:
    """Return arrays with one row per instance, after a check of their types and shapes."""
    arrays, _ = envelope.unpack(kind.value, data)
    count = len(arrays.get("instances", ()))
    checked: dict[str, NDArray[Any]] = {}
    for name, (dtype, rest) in shapes.items():
        array = arrays.get(name)
        if array is None or array.dtype != dtype or array.shape != (count, *rest):
            raise CorruptArtifact(f"artifact: {name} is not {(count, *rest)} {np.dtype(dtype)}")
        checked[name] = array
    return checked
