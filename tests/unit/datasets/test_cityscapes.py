import json
from pathlib import Path

import numpy as np
import pytest
from cityscapesscripts.helpers.annotation import Annotation
from cityscapesscripts.helpers.csHelpers import getCoreImageFileName
from cityscapesscripts.preparation.json2instanceImg import createInstanceImage
from cityscapesscripts.preparation.json2labelImg import createLabelImage
from PIL import Image

from tests.unit.datasets.frames import labelled
from valerie.datasets import cityscapes
from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.polygons import lost_pixels, polygons_document
from valerie.errors import CorruptArtifact, InvalidInput, NotFound
from valerie.labels import VOID


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(3):
        cityscapes.write_picture(tmp_path, "val", labelled(number))
        frame = labelled(number)
        cityscapes.write_labels(tmp_path, "val", frame, polygons_document(frame.segment_ids))
    return tmp_path


def test_what_is_written_is_read_back_exactly(folder: Path) -> None:
    frames = CityscapesFolder(folder, "val")
    assert CityscapesFolder.splits(folder) == ("val",)
    assert frames.has_instances
    assert len(frames) == 3
    for number, frame in enumerate(frames):
        expected = labelled(number)
        assert frame.name == expected.name
        for field in ("picture", "class_map", "instance_map"):
            np.testing.assert_array_equal(getattr(frame, field), getattr(expected, field))


def test_names_are_those_that_cityscapes_scripts_expect(folder: Path) -> None:
    file = folder / "gtFine/val/testtown/testtown_000001_000000_gtFine_labelIds.png"
    assert file.is_file()
    assert getCoreImageFileName(str(file)) == "testtown_000001_000000"


def test_instance_ids_are_sixteen_bits_and_stuff_keeps_its_label_id(folder: Path) -> None:
    with Image.open(folder / "gtFine/val/testtown/testtown_000000_000000_gtFine_instanceIds.png") as image:
        assert image.mode.startswith("I;16")
        assert set(np.unique(np.asarray(image)).tolist()) == {4, 7, 8, 23, 33, 24_001, 24_002, 26_001}


def test_polygons_painted_by_cityscapes_scripts_give_the_same_labels_and_as_many_instances(folder: Path) -> None:
    annotation = Annotation()
    annotation.fromJsonFile(str(folder / "gtFine/val/testtown/testtown_000002_000000_gtFine_polygons.json"))
    expected = labelled(2)
    np.testing.assert_array_equal(np.asarray(createLabelImage(annotation, "ids")), expected.class_map)
    painted = np.asarray(createInstanceImage(annotation, "ids"))
    persons = [n for n in np.unique(painted).tolist() if n // 1000 == 24]
    assert len(persons) == 2


def test_what_lies_in_a_hole_is_painted_after_what_surrounds_it() -> None:
    class_map = np.full((30, 30), 7, np.uint8)
    class_map[5:25, 5:25] = 11
    class_map[10:20, 10:20] = 7  # road in a house in a road
    class_map[14:16, 14:16] = 21
    class_map[2, 2] = 17  # a single pixel
    document = polygons_document(class_map.astype(np.uint16))
    annotation = Annotation()
    annotation.fromJsonText(json.dumps(document))
    np.testing.assert_array_equal(np.asarray(createLabelImage(annotation, "ids")), class_map)


def interlocked() -> np.ndarray:
    """Return two classes without instances and a bicycle, grown into each other at random, (60, 80) label ids."""
    rng = np.random.default_rng(1)
    class_map = np.where(rng.random((60, 80)) < 0.5, 21, 11).astype(np.uint8)
    class_map[20:40, 20:60][rng.random((20, 40)) < 0.4] = 33
    return class_map


def test_polygons_of_interlocked_classes_without_instances_lose_nothing_and_tell_what_others_lose() -> None:
    class_map = interlocked()
    segment_ids = class_map.astype(np.uint16)
    segment_ids[class_map == 33] = 33_001
    document = polygons_document(segment_ids)
    annotation = Annotation()
    annotation.fromJsonText(json.dumps(document))
    shown = np.asarray(createLabelImage(annotation, "ids"))
    np.testing.assert_array_equal(shown[class_map != 33], class_map[class_map != 33])
    lost = int((shown != class_map).sum())
    assert lost > 0
    counts = {name: int((class_map == label).sum()) for name, label in (("building", 11), ("vegetation", 21))}
    expected = {name: (count, 0) for name, count in counts.items()} | {"bicycle": (int((class_map == 33).sum()), lost)}
    assert lost_pixels(document, class_map) == expected


def test_predictions_are_written_as_label_ids(tmp_path: Path) -> None:
    name = labelled().name
    path = cityscapes.write_prediction(tmp_path, "val", name, "some-net", np.array([[0, 11, VOID]], np.uint8))
    assert path.name == "testtown_000000_000000_pred_labelIds.png"
    assert np.asarray(Image.open(tmp_path / path)).tolist() == [[7, 24, 0]]


def test_a_picture_without_labels_is_named(folder: Path) -> None:
    (folder / "gtFine/val/testtown/testtown_000001_000000_gtFine_labelIds.png").unlink()
    with pytest.raises(NotFound, match="testtown_000001_000000_gtFine_labelIds"):
        CityscapesFolder(folder, "val")


def test_a_split_that_is_not_there_is_told(folder: Path) -> None:
    with pytest.raises(NotFound, match="train"):
        CityscapesFolder(folder, "train")


def test_a_broken_picture_and_wrong_ids_are_named(folder: Path) -> None:
    gt = folder / "gtFine/val/testtown"
    (folder / "leftImg8bit/val/testtown/testtown_000000_000000_leftImg8bit.png").write_bytes(b"no picture")
    Image.fromarray(np.full((24, 40), 77, np.uint8)).save(gt / "testtown_000001_000000_gtFine_labelIds.png")
    Image.fromarray(np.full((24, 40, 3), 7, np.uint8)).save(gt / "testtown_000002_000000_gtFine_labelIds.png")
    frames = CityscapesFolder(folder, "val")
    with pytest.raises(CorruptArtifact, match="testtown_000000"):
        frames[0]
    with pytest.raises(InvalidInput, match=r"testtown_000001.*77"):
        frames[1]
    with pytest.raises(InvalidInput, match="testtown_000002"):
        frames[2]


def test_labels_without_instances_have_none(folder: Path) -> None:
    for path in folder.glob("gtFine/val/*/*_instanceIds.png"):
        path.unlink()
    frames = CityscapesFolder(folder, "val")
    assert not frames.has_instances
    assert not frames[0].instance_map.any()
