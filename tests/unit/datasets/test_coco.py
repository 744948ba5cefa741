import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as masks
from pycocotools.coco import COCO

from tests.unit.datasets.frames import labelled
from valerie.datasets import coco

#: Of pycocotools' own code under numpy 2.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


@given(arrays(np.bool_, st.tuples(st.integers(1, 40), st.integers(1, 40)), elements=st.booleans()))
def test_run_lengths_are_those_of_pycocotools(mask: np.ndarray) -> None:
    mine = coco.run_lengths(mask)
    theirs = masks.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert mine == {"size": list(theirs["size"]), "counts": theirs["counts"].decode()}


def test_long_runs_need_several_groups() -> None:
    mask = np.zeros((700, 900), np.bool_)
    mask[100:600, 300:303] = True
    decoded = masks.decode(coco.run_lengths(mask))
    np.testing.assert_array_equal(decoded.astype(bool), mask)


def test_pycocotools_reads_instances_visible_and_amodal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = labelled()
    annotations = [
        {"id": n + 1, "image_id": 1, **a.annotation()} for n, a in enumerate(coco.instance_annotations(frame))
    ]
    height, width = frame.class_map.shape
    document = coco.assemble([{"id": 1, "width": width, "height": height, "file_name": "x.png"}], annotations, "test")
    path = tmp_path / "instances.json"
    path.write_text(json.dumps(document))
    read = COCO(str(path))
    capsys.readouterr()
    assert {read.cats[i]["name"] for i in read.getCatIds()} >= {"person", "car"}
    persons = read.loadAnns(read.getAnnIds(catIds=[24]))
    assert [person["instance_id"] for person in persons] == [24_001, 24_002]
    for person in persons:
        visible = frame.instance_map == person["instance_id"]
        np.testing.assert_array_equal(read.annToMask(person).astype(bool), visible)
        assert person["area"] == masks.area(person["segmentation"]) == visible.sum() == person["i_area"]
        assert list(masks.toBbox(person["segmentation"])) == person["bbox"]
        np.testing.assert_array_equal(masks.decode(person["a_segm"]).astype(bool), frame.amodal[person["instance_id"]])
        assert list(masks.toBbox(person["a_segm"])) == person["a_bbox"]
    assert persons[1]["a_area"] > persons[1]["i_area"]
    assert persons[1]["occlusion_rate"] == 0.25
    (car,) = read.loadAnns(read.getAnnIds(catIds=[26]))
    assert "a_segm" not in car


def test_panoptic_segments_cover_what_is_evaluated_and_nothing_else() -> None:
    frame = labelled()
    ids = coco.panoptic_ids(frame)
    coded = coco.panoptic_picture(ids).astype(np.uint32)
    np.testing.assert_array_equal(coded[..., 0] + 256 * coded[..., 1] + 256**2 * coded[..., 2], ids)
    segments = {segment["id"]: segment for segment in coco.panoptic_segments(ids)}
    assert set(segments) == {7, 8, 23, 33, 24_001, 24_002, 26_001}
    assert (ids == 0).sum() == (frame.class_map == 4).sum()
    assert sum(segment["area"] for segment in segments.values()) == (ids > 0).sum()
    assert segments[33]["iscrowd"] == 1  # bicycles that no label tells apart
    assert segments[24_001]["iscrowd"] == segments[7]["iscrowd"] == 0
    assert segments[24_002]["category_id"] == 24
    assert segments[24_001]["bbox"] == [6, 9, 3, 12]
