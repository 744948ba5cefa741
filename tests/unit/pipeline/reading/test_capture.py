"""Labels and image in step: a board of two classes, drawn as light and as labels, seen through distorting lenses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from valerie.pipeline.reading.capture import moved_truth
from valerie.rendering.base import GroundTruth, PersonTruth
from valerie.rendering.visibility import measure_pixels
from valerie.sensing.sensor import Shot, develop, seen_from
from valerie.sensing.settings import SensorSetting

WIDTH, HEIGHT = 320, 180
PERSON = 24001


def distorted_truth(truth: GroundTruth, setting: SensorSetting, focal_length: float) -> GroundTruth:
    height, width = truth.class_map.shape
    return moved_truth(truth, setting, seen_from(setting, width, height, focal_length_mm=focal_length), focal_length)


def board() -> GroundTruth:
    """Tiles of road and person; one person is a tile that reaches beyond the left border, by half."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    dark = ((rows // 20 + columns // 20) % 2).astype(np.bool_)
    amodal = np.zeros((HEIGHT, WIDTH), np.bool_)
    amodal[40:120, :30] = True
    return GroundTruth(
        class_map=np.where(dark, np.uint8(24), np.uint8(7)),
        instance_map=np.where(dark & amodal, np.uint16(PERSON), np.uint16(0)),
        depth=np.where(dark, np.float32(10.0), np.float32(30.0)),
        persons=(PersonTruth.of(PERSON, amodal, 2 * int(amodal.sum())),),
    )


LENSES = [
    {"k1": -0.5},
    {"k1": 0.6},
    {"k1": -0.3, "k2": 0.2, "p1": 0.02, "p2": -0.03, "k3": 0.1},
]


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("focal_length", [20.0, 50.0])
def test_every_label_edge_is_within_one_pixel_of_the_image_edge(lens: dict[str, float], focal_length: float) -> None:
    truth = board()
    setting = SensorSetting.model_validate({"distortion": lens, "curve": "srgb"})
    linear = np.repeat(np.where(truth.class_map == 24, 0.0, 1.0)[..., None], 3, axis=2).astype(np.float16)
    picture = develop(linear, setting, Shot(focal_length_mm=focal_length))[..., 1]
    distorted = distorted_truth(truth, setting, focal_length)
    assert (distorted.class_map != truth.class_map).any()
    # Half of the light of an edge is 188 of 255 after the sRGB transfer.
    bright = picture > 188
    wrong = bright != (distorted.class_map == 7)
    edge = cv2.dilate(distorted.class_map, np.ones((3, 3), np.uint8)) != cv2.erode(
        distorted.class_map, np.ones((3, 3), np.uint8)
    )
    assert not (wrong & ~edge).any()


@pytest.mark.parametrize("lens", LENSES)
def test_all_maps_move_together(lens: dict[str, float]) -> None:
    setting = SensorSetting.model_validate({"distortion": lens})
    distorted = distorted_truth(board(), setting, 50.0)
    np.testing.assert_array_equal(distorted.class_map == 24, distorted.depth == 10.0)
    (person,) = distorted.persons
    np.testing.assert_array_equal(distorted.instance_map == PERSON, (distorted.class_map == 24) & person.amodal)
    assert not distorted.class_map.flags.writeable


def test_the_whole_person_is_counted_in_pixels_of_the_picture() -> None:
    truth = board()
    plain = measure_pixels(truth.persons[0], truth)
    assert plain.truncation_rate == 0.5
    drawn_out = distorted_truth(truth, SensorSetting.model_validate({"distortion": {"k1": 0.6}}), 50.0)
    view = measure_pixels(drawn_out.persons[0], drawn_out)
    # A pincushion draws the border outwards: more of the person is beyond it.
    assert view.truncation_rate is not None
    assert plain.truncation_rate < view.truncation_rate < 1.0


def test_who_is_out_of_the_picture_is_truncated_altogether() -> None:
    truth = board()
    amodal = np.zeros((HEIGHT, WIDTH), np.bool_)
    amodal[0:4, 0:4] = True
    corner = GroundTruth(
        truth.class_map, np.zeros_like(truth.instance_map), truth.depth, (PersonTruth.of(PERSON, amodal, 16),)
    )
    distorted = distorted_truth(corner, SensorSetting.model_validate({"distortion": {"k1": 0.6}}), 50.0)
    view = measure_pixels(distorted.persons[0], distorted)
    assert (view.pixel_area_amodal, view.truncation_rate, view.undefined_reason) == (0, 1.0, "outside the image")
