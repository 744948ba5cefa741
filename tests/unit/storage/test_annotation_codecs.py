"""Annotations go to bytes and come back bit for bit."""

from dataclasses import fields

import numpy as np
import pytest

from valerie.errors import CorruptArtifact
from valerie.rendering.annotations.boxes import Boxes, measure_boxes
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.joints import measure_joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.rendering.annotations.normals import Normals
from valerie.rendering.base import GroundTruth, View
from valerie.storage import envelope
from valerie.storage.annotation_codecs import (
    decode_boxes,
    decode_flow,
    decode_joints,
    decode_normals,
    encode_annotation,
)
from valerie.testing.assets import simple_asset


def some_boxes() -> Boxes:
    shape = (9, 16)
    truth = GroundTruth(np.zeros(shape, np.uint8), np.zeros(shape, np.uint16), np.ones(shape, np.float32), ())
    return measure_boxes(simple_asset().base, View("camera-1", 16, 9), truth)


def test_normals_come_back_as_they_were() -> None:
    octahedral = np.random.default_rng(1).integers(-32768, 32768, (5, 7, 2)).astype(np.int16)
    back = decode_normals(encode_annotation(AnnotationKind.NORMALS, Normals(octahedral)))
    assert np.array_equal(back.octahedral, octahedral)


def test_boxes_come_back_as_they_were() -> None:
    boxes = some_boxes()
    back = decode_boxes(encode_annotation(AnnotationKind.BOXES, boxes))
    assert len(back.instances) == 2
    for field in fields(boxes):
        assert getattr(back, field.name).tobytes() == getattr(boxes, field.name).tobytes()


def test_joints_come_back_as_they_were() -> None:
    view = View("camera-1", 16, 9)
    truth = GroundTruth(np.zeros((9, 16), np.uint8), np.zeros((9, 16), np.uint16), np.ones((9, 16), np.float32), ())
    joints = measure_joints(simple_asset().base, view, truth)
    back = decode_joints(encode_annotation(AnnotationKind.JOINTS, joints))
    assert len(back.instances) == 1
    for field in fields(joints):
        assert getattr(back, field.name).tobytes() == getattr(joints, field.name).tobytes()


def test_boxes_of_different_lengths_are_refused() -> None:
    arrays = {field.name: getattr(some_boxes(), field.name) for field in fields(Boxes)}
    arrays["sizes"] = arrays["sizes"][:1]
    with pytest.raises(CorruptArtifact, match="sizes is not"):
        decode_boxes(envelope.pack("boxes", arrays, {}))


def test_one_kind_is_not_taken_for_another() -> None:
    with pytest.raises(CorruptArtifact, match="'boxes' where 'normals' was expected"):
        decode_normals(encode_annotation(AnnotationKind.BOXES, some_boxes()))


def test_normals_of_another_shape_are_refused() -> None:
    with pytest.raises(CorruptArtifact, match="int16"):
        decode_normals(envelope.pack("normals", {"octahedral": np.zeros((4, 4, 3), np.int16)}, {}))


def test_flow_comes_back_as_it_was_and_is_no_velocity() -> None:
    vectors = np.random.default_rng(0).normal(size=(5, 7, 2)).astype(np.float32)
    vectors[2, 3] = np.nan
    data = encode_annotation(AnnotationKind.FLOW, FlowMap(vectors))
    back = decode_flow(data)
    np.testing.assert_array_equal(back.vectors, vectors)
    assert back.defined.sum() == 34
    with pytest.raises(CorruptArtifact):
        decode_flow(data, kind=AnnotationKind.VELOCITY)
    with pytest.raises(CorruptArtifact, match="height, width, 2"):
        decode_flow(encode_annotation(AnnotationKind.FLOW, FlowMap(vectors[0])))
