from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.unit.datasets.frames import labelled
from valerie.datasets import cityscapes
from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.frame import LabelledFrame
from valerie.datasets.twins import matched, person_twins
from valerie.errors import InvalidInput

PAIRS = [(24_001, 24_002), (24_002, 24_001)]


def folder(root: Path, *frames: LabelledFrame) -> CityscapesFolder:
    for frame in frames:
        cityscapes.write_picture(root, "val", frame)
        cityscapes.write_labels(root, "val", frame)
    return CityscapesFolder(root, "val")


def shifted(frame: LabelledFrame, by: int) -> LabelledFrame:
    """Move the instances to the right, and number the persons the other way round."""
    instances = np.roll(frame.instance_map, by, axis=1)
    people = np.isin(instances, (24_001, 24_002))
    return replace(frame, instance_map=np.where(people, np.uint16(48_003) - instances, instances))


def test_persons_are_matched_by_place_not_by_number(tmp_path: Path) -> None:
    here = folder(tmp_path / "here", labelled(0), labelled(1), labelled(2))
    there = folder(tmp_path / "there", shifted(labelled(1), 1), shifted(labelled(2), 0), labelled(9))
    names = [labelled(1).name, labelled(2).name]
    assert person_twins(here, there) == [(name, own, other) for name in names for own, other in PAIRS]


def test_a_person_has_one_twin_and_cars_have_none() -> None:
    own = np.zeros((20, 40), np.uint16)
    own[:10, 0:10], own[:10, 4:14], own[12:, 20:30] = 24_001, 24_002, 26_001
    other = np.zeros_like(own)
    other[:10, 4:14], other[12:, 20:30] = 24_007, 24_008
    # Both persons overlap the one there, and the second covers it wholly.
    assert matched(own, other) == [(24_002, 24_007)]


def test_a_person_elsewhere_is_no_twin() -> None:
    own, other = np.zeros((20, 40), np.uint16), np.zeros((20, 40), np.uint16)
    own[:10, :10], other[:10, 6:16] = 24_001, 24_001  # boxes overlap by a quarter
    assert matched(own, other) == []


def test_data_sets_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    here = folder(tmp_path / "here", labelled(0))
    with pytest.raises(InvalidInput, match="share no frame"):
        person_twins(here, folder(tmp_path / "other", labelled(1)))
    with pytest.raises(InvalidInput, match="another size"):
        person_twins(here, folder(tmp_path / "small", labelled(0, height=18)))
    bare = folder(tmp_path / "bare", labelled(0))
    for path in bare.root.glob("gtFine/val/*/*_instanceIds.png"):
        path.unlink()
    with pytest.raises(InvalidInput, match="do not distinguish persons"):
        person_twins(here, CityscapesFolder(bare.root, "val"))
