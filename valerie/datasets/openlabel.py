"""Labels of a sequence as ASAM OpenLABEL 1.0 (https://www.asam.net/standards/detail/openlabel/).

An object is an instance of an evaluated class. Its boxes are ``visible`` and, for persons, ``amodal``: x and y of the centre,
width and height, in pixels. Its masks are COCO's compressed run-length codes. Pixel centres count from 0. The camera's position
and direction are those of `valerie.datasets.camera`; its own axes are x right, y down, z ahead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Final

import numpy as np
from typing_extensions import TypedDict

from valerie.datasets.camera import CameraDocument
from valerie.datasets.coco import Instance
from valerie.labels import BY_ID
from valerie.plain import JsonObject

CAMERA: Final = "camera"
VEHICLE: Final = "vehicle-iso8855"
_CLASSES: Final = "https://www.cityscapes-dataset.com/dataset-overview/#class-definitions"
_IN_PICTURE: Final = {"coordinate_system": CAMERA}


class LabelledObject(TypedDict):
    """An object in one frame; ``object_data`` has its boxes, masks and measures by their type."""

    name: str
    type: str
    object_data: dict[str, list[JsonObject]]


@dataclass(frozen=True, slots=True)
class SequenceFrame:
    """One frame of a sequence.

    Attributes:
        picture: path below the data set.
        objects: instance id to object.
    """

    picture: str
    objects: dict[str, LabelledObject]


def labelled_objects(instances: Sequence[Instance]) -> dict[str, LabelledObject]:
    """Return the objects of a frame by instance id."""
    objects: dict[str, LabelledObject] = {}
    for instance in instances:
        kind = BY_ID[instance.category_id].name
        shapes = {"visible": instance.visible}
        if instance.amodal is not None and instance.amodal["area"]:
            shapes["amodal"] = instance.amodal
        data: dict[str, list[JsonObject]] = {
            "bbox": [{"name": name, "val": _centred(shape["bbox"]), **_IN_PICTURE} for name, shape in shapes.items()],
            "binary": [
                {
                    "name": name,
                    "val": shape["segm"]["counts"],
                    "encoding": "COCO run lengths",
                    "data_type": "mask",
                    "attributes": {"vec": [{"name": "height, width", "val": shape["segm"]["size"]}]},
                    **_IN_PICTURE,
                }
                for name, shape in shapes.items()
            ],
        }
        for name, value in instance.measures.items():
            if value is not None:
                data.setdefault(_type_of(value), []).append({"name": name, "val": value})
        number = str(instance.instance_id)
        objects[number] = {"name": f"{kind} {number}", "type": kind, "object_data": data}
    return objects


def camera_entries(camera: CameraDocument, width: int, height: int) -> JsonObject:
    """Return a document's entries for the camera: its coordinate system and its stream.

    Args:
        camera: position, direction and focal length.
        width, height: size of the pictures.
    """
    inner = camera["intrinsic"]
    matrix = [inner["fx"], 0, inner["u0"], 0, 0, inner["fy"], inner["v0"], 0, 0, 0, 1, 0]
    pinhole: JsonObject = {
        "camera_matrix": matrix,
        "distortion_coeffs": [0.0] * 5,
        "width_px": width,
        "height_px": height,
    }
    return {
        "coordinate_systems": {
            VEHICLE: {"type": "local_cs", "parent": "", "children": [CAMERA]},
            CAMERA: {"type": "sensor_cs", "parent": VEHICLE, "children": [], "pose_wrt_parent": _pose(camera)},
        },
        "streams": {CAMERA: {"type": "camera", "stream_properties": {"intrinsics_pinhole": pinhole}}},
    }


def assemble(frames: Mapping[int, SequenceFrame], camera: JsonObject, description: str) -> JsonObject:
    """Return the OpenLABEL document of a sequence.

    Args:
        frames: frame number to frame, in order.
        camera: `camera_entries` of the camera that took all frames.
    """
    objects: dict[str, JsonObject] = {}
    spans_of: dict[str, list[dict[str, int]]] = {}
    intervals: list[dict[str, int]] = []
    for number, frame in frames.items():
        _extend(intervals, number)
        for uid, entry in frame.objects.items():
            spans = spans_of.setdefault(uid, [])
            objects.setdefault(
                uid,
                {"name": entry["name"], "type": entry["type"], "ontology_uid": "0", "frame_intervals": spans},
            )
            _extend(spans, number)
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0", "name": description},
            "ontologies": {"0": _CLASSES},
            **camera,
            "frame_intervals": intervals,
            "objects": objects,
            "frames": {
                str(number): {
                    "frame_properties": {"streams": {CAMERA: {"uri": frame.picture}}},
                    "objects": {uid: {"object_data": entry["object_data"]} for uid, entry in frame.objects.items()},
                }
                for number, frame in frames.items()
            },
        }
    }


def _centred(box: Sequence[int]) -> list[float]:
    """Return a box as centre and size; ``box`` starts with its first column and row."""
    x, y, width, height = box
    return [x + (width - 1) / 2, y + (height - 1) / 2, width, height]


def _type_of(value: object) -> str:
    if isinstance(value, bool):
        return "boolean"
    return "text" if isinstance(value, str) else "num"


def _extend(intervals: list[dict[str, int]], number: int) -> None:
    """Add a frame to intervals of consecutive frames."""
    if intervals and intervals[-1]["frame_end"] == number - 1:
        intervals[-1]["frame_end"] = number
    else:
        intervals.append({"frame_start": number, "frame_end": number})


def _pose(camera: CameraDocument) -> dict[str, list[float]]:
    """Return the transform from the axes of the camera to those of the vehicle, row by row."""
    outer = camera["extrinsic"]
    cy, sy, cp, sp, cr, sr = (f(outer[angle]) for angle in ("yaw", "pitch", "roll") for f in (cos, sin))
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    axes = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # columns: right, down, ahead
    pose = np.eye(4)
    pose[:3, :3] = yaw @ pitch @ roll @ axes
    pose[:3, 3] = outer["x"], outer["y"], outer["z"]
    return {"matrix4x4": pose.ravel().tolist()}
