from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from valerie.errors import InvalidInput
from valerie.labels import to_train_ids
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.instances import InstanceCounts, person_counts


@dataclass
class Person:
    instance_id: int


@dataclass
class Truth:
    instance_map: np.ndarray
    persons: list[Person]


INSTANCES = np.array([[24001, 24001, 0], [24002, 24001, 26001], [24002, 0, 0]], np.uint16)


def test_hand_counted_persons() -> None:
    predicted = np.array([[11, 0, 11], [11, 11, 11], [255, 0, 0]], np.uint8)
    truth = Truth(INSTANCES, [Person(24001), Person(24002)])
    assert person_counts(truth, predicted) == (InstanceCounts(24001, 2, 1), InstanceCounts(24002, 1, 1))


def test_a_hidden_person_is_listed_without_pixels() -> None:
    truth = Truth(INSTANCES, [Person(24001), Person(24002), Person(24007)])
    assert InstanceCounts(24007, 0, 0) in person_counts(truth, np.zeros((3, 3), np.uint8))


def test_neighbouring_classes_are_not_counted_as_persons() -> None:
    instances = np.array([[23999, 24000, 24999, 25000, 0, 65535]], np.uint16)
    predicted = np.full((1, 6), 11, np.uint8)
    assert person_counts(Truth(instances, []), predicted) == (InstanceCounts(24000, 1, 0), InstanceCounts(24999, 1, 0))


def test_a_rider_predicted_as_person_is_no_true_positive_of_a_person() -> None:
    predicted = np.full((3, 3), 12, np.uint8)
    assert all(tp == 0 for tp in (counts.tp for counts in person_counts(Truth(INSTANCES, []), predicted)))


@given(
    arrays(np.uint16, (6, 8), elements=st.sampled_from([0, 24001, 24002, 24003, 26001])),
    arrays(np.uint8, (6, 8), elements=st.sampled_from([0, 11, 12, 255])),
)
def test_persons_add_up_to_the_frames_confusion_matrix(instances: np.ndarray, predicted: np.ndarray) -> None:
    class_map = (instances // 1000).astype(np.uint8)
    matrix = confusion_matrix(to_train_ids(class_map), predicted)
    counts = person_counts(Truth(instances, []), predicted)
    assert sum(count.tp for count in counts) == matrix[11, 11]
    assert sum(count.fn for count in counts) == matrix[11].sum() - matrix[11, 11]


def test_maps_of_different_shape_are_refused() -> None:
    with pytest.raises(InvalidInput, match="shape"):
        person_counts(Truth(INSTANCES, []), np.zeros((3, 4), np.uint8))
