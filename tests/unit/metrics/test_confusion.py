from unittest import mock

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.metrics import confusion_matrix as sklearn_confusion_matrix

from valerie.errors import InvalidInput
from valerie.metrics import confusion
from valerie.metrics.confusion import confusion_matrix

TRAIN_IDS = np.array([*range(19), 255], np.uint8)


def random_map(seed: int, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    return np.random.default_rng(seed).choice(TRAIN_IDS, shape)


def test_a_hand_counted_image() -> None:
    truth = np.array([[11, 11, 0], [11, 0, 0], [255, 255, 0]], np.uint8)
    predicted = np.array([[11, 0, 0], [255, 11, 0], [11, 0, 0]], np.uint8)
    matrix = confusion_matrix(truth, predicted)
    assert matrix[11, 11] == 1
    assert matrix[11, 0] == 1
    assert matrix[11, 19] == 1
    assert matrix[0, 11] == 1
    assert matrix[0, 0] == 3
    assert matrix.sum() == 7
    assert matrix.dtype == np.int64
    assert matrix.shape == (19, 20)


def test_scikit_learn_gives_the_same_counts() -> None:
    truth, predicted = random_map(0), random_map(1)
    labelled = truth != 255
    oracle = sklearn_confusion_matrix(truth[labelled], predicted[labelled], labels=TRAIN_IDS)
    np.testing.assert_array_equal(confusion_matrix(truth, predicted), oracle[:19])


def test_torchmetrics_gives_the_same_counts_without_predicted_void() -> None:
    torch = pytest.importorskip("torch")
    from torchmetrics.functional.classification import multiclass_confusion_matrix

    truth = random_map(2)
    predicted = np.random.default_rng(3).integers(0, 19, truth.shape).astype(np.uint8)
    oracle = multiclass_confusion_matrix(
        torch.from_numpy(predicted.astype(int)), torch.from_numpy(truth.astype(int)), 19, ignore_index=255
    )
    matrix = confusion_matrix(truth, predicted)
    np.testing.assert_array_equal(matrix[:, :19], oracle.numpy())
    assert matrix[:, 19].sum() == 0


@given(
    arrays(np.uint8, (5, 7), elements=st.sampled_from(TRAIN_IDS.tolist())),
    arrays(np.uint8, (5, 7), elements=st.sampled_from(TRAIN_IDS.tolist())),
)
def test_opencv_changes_no_count_and_loses_no_labelled_pixel(truth: np.ndarray, predicted: np.ndarray) -> None:
    fast = confusion_matrix(truth, predicted)
    with mock.patch.object(confusion, "cv2", None):
        np.testing.assert_array_equal(fast, confusion_matrix(truth, predicted))
    np.testing.assert_array_equal(fast.sum(axis=1), [(truth == k).sum() for k in range(19)])
    assert (fast >= 0).all()


def test_strided_maps_count_like_their_copies() -> None:
    truth, predicted = random_map(4)[::2, ::3], random_map(5)[::2, ::3]
    np.testing.assert_array_equal(confusion_matrix(truth, predicted), confusion_matrix(truth.copy(), predicted.copy()))


def test_counts_stay_exact_where_float32_would_not() -> None:
    pixels = (1 << 24) + 3
    truth = np.full((1, pixels), 11, np.uint8)
    assert confusion_matrix(truth, truth)[11, 11] == pixels


def test_an_empty_image_has_no_counts() -> None:
    empty = np.zeros((0, 4), np.uint8)
    assert confusion_matrix(empty, empty).sum() == 0


@pytest.mark.parametrize("opencv", [cv2, None])
@pytest.mark.parametrize("name", ["truth", "predicted"])
def test_a_value_that_is_no_train_id_is_named(opencv: object, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(confusion, "cv2", opencv)
    maps = {"truth": random_map(6), "predicted": random_map(7)}
    maps[name][0, 0] = 24
    with pytest.raises(InvalidInput, match=f"{name}: not a train id; got 24"):
        confusion_matrix(**maps)


def test_maps_of_different_shape_are_refused() -> None:
    with pytest.raises(InvalidInput, match="shape"):
        confusion_matrix(random_map(8), random_map(9, (60, 81)))


def test_maps_of_another_type_are_refused() -> None:
    with pytest.raises(InvalidInput, match="int64"):
        confusion_matrix(random_map(8).astype(np.int64), random_map(9))
