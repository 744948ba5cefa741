import numpy as np
import pytest

from tests.unit.datasets.frames import labelled
from valerie.datasets.frame import FrameName, LabelledFrame, require_label_ids
from valerie.errors import InvalidInput


def test_a_name_is_spelled_and_parsed_as_in_cityscapes() -> None:
    name = FrameName.of("first run_camera 1", 12, 3)
    assert str(name) == "first-run-camera-1_000012_000003"
    assert FrameName.parse(f"{name}_gtFine_labelIds.png") == name


def test_more_than_six_digits_are_kept() -> None:
    assert FrameName.of("a", 1_234_567, 0).sequence == "1234567"


def test_another_file_name_is_refused() -> None:
    with pytest.raises(InvalidInput, match="photo"):
        FrameName.parse("photo.png")


def test_maps_of_another_size_are_refused() -> None:
    frame = labelled()
    with pytest.raises(InvalidInput, match="do not fit"):
        LabelledFrame(frame.name, frame.picture, frame.class_map[1:], frame.instance_map)


def test_label_ids_that_cityscapes_lacks_are_refused_by_name() -> None:
    require_label_ids(np.array([[0, 33, 255]], np.uint8), field="x")
    with pytest.raises(InvalidInput, match=r"a\.png.*34"):
        require_label_ids(np.array([[0, 34]], np.uint8), field="a.png")


def test_runs_whose_names_differ_in_letters_of_other_scripts_have_cities_of_their_own() -> None:
    cities = {FrameName.of(f"{name}-camera-1", 0, 0).city for name in ("Köln", "Kln", "東京", "京都")}
    assert len(cities) == 4
    assert "Koeln-camera-1" in cities
