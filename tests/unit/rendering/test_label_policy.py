"""Labels as annotators draw them: which gaps close, and what they never touch."""

import numpy as np
import pytest

from valerie.labels import BY_NAME
from valerie.rendering.base import GroundTruth, PersonTruth
from valerie.rendering.label_policy import LabelPolicy, labelled

ROAD, SKY, PERSON, CAR = (BY_NAME[name].id for name in ("road", "sky", "person", "car"))
SHAPE = (180, 240)


def scene_of(name: str, *, spacing: int = 8, instance: int = 0) -> GroundTruth:
    """A lattice of an object 10 m away, before a road 50 m away and sky."""
    class_map = np.full(SHAPE, ROAD, np.uint8)
    class_map[:60] = SKY
    depth = np.where(class_map == SKY, np.inf, 50.0).astype(np.float32)
    lattice = np.zeros(SHAPE, np.bool_)
    lattice[40:140:spacing] = lattice[:, 60:180:spacing] = True
    lattice[:40] = lattice[141:] = lattice[:, :60] = lattice[:, 181:] = False
    class_map[lattice], depth[lattice] = BY_NAME[name].id, 10.0
    instances = np.where(lattice, instance, 0).astype(np.uint16)
    return GroundTruth(class_map, instances, depth, ())


INSIDE = (slice(49, 118), slice(69, 158))


def test_exact_labels_are_the_truth_itself() -> None:
    truth = scene_of("vegetation")
    assert labelled(truth, LabelPolicy.EXACT) is truth


@pytest.mark.parametrize(
    ("name", "spacing", "instance"),
    [("vegetation", 4, 0), ("fence", 20, 0), ("bicycle", 10, 33_002), ("motorcycle", 10, 32_001)],
)
def test_gaps_take_the_class_and_instance_of_what_surrounds_them(name: str, spacing: int, instance: int) -> None:
    truth = scene_of(name, spacing=spacing, instance=instance)
    drawn = labelled(truth, LabelPolicy.CITYSCAPES)
    # A row and a column in ``spacing``, with one more or less of the 69 rows and 89 columns.
    share = 1 - (1 - 1 / spacing) ** 2
    assert (truth.class_map[INSIDE] == BY_NAME[name].id).mean() == pytest.approx(share, abs=1 / 69 + 1 / 89)
    assert (drawn.class_map[INSIDE] == BY_NAME[name].id).all()
    assert (drawn.instance_map[INSIDE] == instance).all()
    # Neither its outline nor what is seen grows, and depths stay.
    np.testing.assert_array_equal(drawn.class_map[:38], truth.class_map[:38])
    np.testing.assert_array_equal(drawn.class_map[:, 184:], truth.class_map[:, 184:])
    np.testing.assert_array_equal(drawn.depth, truth.depth)


@pytest.mark.parametrize("name", ["pole", "person", "car", "building"])
def test_other_classes_keep_their_gaps(name: str) -> None:
    truth = scene_of(name, spacing=4, instance=1000 * BY_NAME[name].id + 1 if BY_NAME[name].has_instances else 0)
    np.testing.assert_array_equal(labelled(truth, LabelPolicy.CITYSCAPES).class_map, truth.class_map)


def with_box(truth: GroundTruth, label: int, instance: int, depth: float) -> GroundTruth:
    """Put a box of 40 × 40 pixels into the scene; the lattice hides it if it lies behind."""
    box = np.zeros(SHAPE, np.bool_)
    box[70:110, 100:140] = True
    visible = box & (truth.depth > depth)
    class_map, instances, depths = truth.class_map.copy(), truth.instance_map.copy(), truth.depth.copy()
    class_map[visible], instances[visible], depths[visible] = label, instance, depth
    persons = (PersonTruth.of(instance, box, int(box.sum())),) if label == PERSON else ()
    return GroundTruth(class_map, instances, depths, persons)


def test_a_person_behind_leaves_keeps_every_pixel_and_a_car_none_in_their_gaps() -> None:
    leaves = scene_of("vegetation", spacing=4)
    person, car = with_box(leaves, PERSON, 24_001, 20.0), with_box(leaves, CAR, 26_001, 20.0)
    drawn = labelled(person, LabelPolicy.CITYSCAPES)
    np.testing.assert_array_equal(drawn.instance_map == 24_001, person.instance_map == 24_001)
    np.testing.assert_array_equal(drawn.class_map == PERSON, person.class_map == PERSON)
    assert drawn.persons == person.persons
    assert (car.class_map == CAR).any()
    drawn = labelled(car, LabelPolicy.CITYSCAPES)
    assert not (drawn.class_map == CAR).any()
    assert not (drawn.instance_map == 26_001).any()


def test_what_stands_in_front_keeps_every_pixel() -> None:
    truth = with_box(scene_of("fence", spacing=20), CAR, 26_001, 5.0)
    drawn = labelled(truth, LabelPolicy.CITYSCAPES)
    np.testing.assert_array_equal(drawn.class_map == CAR, truth.class_map == CAR)
