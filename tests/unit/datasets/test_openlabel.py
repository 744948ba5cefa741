"""OpenLABEL documents, checked with the schema of ASAM OpenLABEL 1.0 as the package vcd carries it."""

from __future__ import annotations

from typing import Any

import jsonschema
import numpy as np
import pytest
from pycocotools import mask as coco_mask
from vcd.schema import openlabel_schema

from tests.unit.datasets.frames import PERSON, labelled
from valerie.datasets.camera import camera_document
from valerie.datasets.coco import instance_annotations
from valerie.datasets.openlabel import SequenceFrame, assemble, camera_entries, labelled_objects
from valerie.scene.graph.model import Camera
from valerie.scene.graph.transforms import camera_transform

#: Of pycocotools' own code under numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")

CAMERA = Camera("scene.camera-1", camera_transform((2.5, -12.0, 1.4), 350.0, 4.0, -3.0), 50.0, 36.0)


def document(*numbers: int) -> dict[str, Any]:
    frames = {
        number: SequenceFrame(f"{number}.png", labelled_objects(instance_annotations(labelled(number))))
        for number in numbers
    }
    return assemble(frames, camera_entries(camera_document(CAMERA, 40, 24), 40, 24), "made by hand")


def test_a_document_fits_the_schema_and_a_wrong_one_does_not() -> None:
    label = document(0, 1, 3)
    jsonschema.Draft7Validator.check_schema(openlabel_schema)
    jsonschema.Draft7Validator(openlabel_schema).validate(label)
    del label["openlabel"]["frames"]["0"]["objects"]["24001"]["object_data"]["bbox"][0]["val"]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft7Validator(openlabel_schema).validate(label)


def test_boxes_masks_and_measures_are_those_of_the_frame() -> None:
    frame, content = labelled(1), document(1)["openlabel"]
    assert content["frames"]["1"]["frame_properties"]["streams"]["camera"]["uri"] == "1.png"
    objects = content["frames"]["1"]["objects"]
    assert objects.keys() == {"24001", "24002", "26001"} == content["objects"].keys()
    assert content["objects"]["26001"]["type"] == "car"
    for uid, one in objects.items():
        masks = {"visible": frame.instance_map == int(uid)}
        if int(uid) // 1000 == PERSON:
            masks["amodal"] = frame.amodal[int(uid)]
        boxes = {entry["name"]: entry["val"] for entry in one["object_data"]["bbox"]}
        assert boxes.keys() == masks.keys()
        for entry in one["object_data"]["binary"]:
            (size,) = entry["attributes"]["vec"]
            pixels = coco_mask.decode({"size": size["val"], "counts": entry["val"].encode()}).astype(bool)
            np.testing.assert_array_equal(pixels, masks[entry["name"]])
            rows, columns = np.nonzero(pixels)
            x, y, width, height = boxes[entry["name"]]
            assert (x - width / 2, x + width / 2) == (columns.min() - 0.5, columns.max() + 0.5)
            assert (y - height / 2, y + height / 2) == (rows.min() - 0.5, rows.max() + 0.5)
    assert objects["24002"]["object_data"]["num"] == [{"name": "occlusion_rate", "val": 0.25}]


def test_intervals_say_in_which_frames_an_object_is() -> None:
    content = document(0, 1, 3)["openlabel"]
    expected = [{"frame_start": 0, "frame_end": 1}, {"frame_start": 3, "frame_end": 3}]
    assert content["frame_intervals"] == content["objects"]["24001"]["frame_intervals"] == expected


def test_a_point_of_the_world_is_projected_to_the_pixel_of_the_scene() -> None:
    content = document(0)["openlabel"]
    point = np.array([1.0, 20.0, 0.9])
    # The scene's own definition: looks along −z, y up.
    local = np.linalg.inv(CAMERA.transform) @ [*point, 1.0]
    focal = 50.0 / 36.0 * 40
    expected = (40 / 2 - focal * local[0] / local[2] - 0.5, 24 / 2 + focal * local[1] / local[2] - 0.5)
    pose = np.reshape(content["coordinate_systems"]["camera"]["pose_wrt_parent"]["matrix4x4"], (4, 4))
    (matrix,) = (
        value["stream_properties"]["intrinsics_pinhole"]["camera_matrix"] for value in content["streams"].values()
    )
    x, y, w = np.reshape(matrix, (3, 4)) @ np.linalg.inv(pose) @ [point[1], -point[0], point[2], 1.0]
    assert (x / w, y / w) == pytest.approx(expected, abs=1e-6)
