"""Panoptic segmentation against cityscapesScripts: its own conversion of our labels, and its own evaluation of our files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cityscapesscripts.evaluation.evalPanopticSemanticLabeling import PQStat, pq_compute_single_core
from cityscapesscripts.preparation.createPanopticImgs import convert2panoptic
from PIL import Image

from tests.unit.datasets.frames import BICYCLE, CAR, PERSON, ROAD, SIDEWALK, SKY, labelled
from valerie.datasets import cityscapes, coco

CATEGORIES = {category["id"]: category for category in coco.CATEGORIES}


def written(folder: Path, number: int) -> dict[str, Any]:
    """Frame ``number`` as a panoptic picture in ``folder``, and its annotation."""
    ids = coco.panoptic_ids(labelled(number))
    cityscapes.save_png(folder / f"{number}.png", coco.panoptic_picture(ids))
    return {"image_id": number, "file_name": f"{number}.png", "segments_info": coco.panoptic_segments(ids)}


def quality(truth: dict[str, Any], predicted: dict[str, Any], folder: Path) -> PQStat:
    return pq_compute_single_core(0, [(truth, predicted)], str(folder), str(folder), CATEGORIES)


def test_cityscapes_scripts_make_the_same_pictures_segments_and_categories_from_our_labels(tmp_path: Path) -> None:
    for number in range(3):
        cityscapes.write_labels(tmp_path, "val", labelled(number))
    convert2panoptic(str(tmp_path / "gtFine"), str(tmp_path), setNames=["val"])
    theirs = json.loads((tmp_path / "cityscapes_panoptic_val.json").read_text())
    assert theirs["categories"] == list(coco.CATEGORIES)
    assert len(theirs["annotations"]) == 3
    for number, annotation in enumerate(theirs["annotations"]):
        ids = coco.panoptic_ids(labelled(number))
        assert annotation["segments_info"] == coco.panoptic_segments(ids)
        with Image.open(tmp_path / "cityscapes_panoptic_val" / annotation["file_name"]) as picture:
            np.testing.assert_array_equal(np.asarray(picture), coco.panoptic_picture(ids))


def test_a_frame_against_itself_has_panoptic_quality_one(tmp_path: Path) -> None:
    annotation = written(tmp_path, 0)
    everything, classes = quality(annotation, annotation, tmp_path).pq_average(CATEGORIES, isthing=None)
    # Bicycles that no label tells apart are a crowd, which counts neither as a hit nor as a miss.
    assert everything == {"pq": 1.0, "sq": 1.0, "rq": 1.0, "n": 5}
    assert {label for label, quality in classes.items() if quality["pq"] == 1.0} == {ROAD, SIDEWALK, SKY, PERSON, CAR}


def test_a_frame_whose_objects_stand_one_pixel_beside_has_the_quality_that_a_hand_computes(tmp_path: Path) -> None:
    stat = quality(written(tmp_path, 0), written(tmp_path, 1), tmp_path)
    everything, classes = stat.pq_average(CATEGORIES, isthing=None)
    # The first person and the car are 3 wide: 2 of 4 columns in common are no match. The second has 33 of 57 pixels in common.
    assert [(stat[label].tp, stat[label].fp, stat[label].fn) for label in (PERSON, CAR)] == [(1, 1, 1), (0, 1, 1)]
    expected = {PERSON: 33 / 57 / 2, CAR: 0.0, ROAD: 390 / 430, SIDEWALK: 98 / 106, SKY: 1.0, BICYCLE: 0.0}
    assert {label: classes[label]["pq"] for label in expected} == pytest.approx(expected)
    assert everything["pq"] == pytest.approx(sum(expected.values()) / 5)
