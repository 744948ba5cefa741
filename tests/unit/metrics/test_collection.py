import numpy as np
import pytest
import torch
from torchmetrics.classification import MulticlassJaccardIndex, MulticlassRecall

from valerie.labels import BY_NAME, PERSON, VOID
from valerie.metrics.collection import collection_scores
from valerie.metrics.confusion import confusion_matrix


def _maps(seed: int, *, classes: int = 19) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    truth = generator.integers(0, classes, (20, 30)).astype(np.uint8)
    predicted = np.where(generator.random((20, 30)) < 0.7, truth, generator.integers(0, classes, (20, 30)))
    truth[generator.random((20, 30)) < 0.1] = VOID
    return truth, predicted.astype(np.uint8)


def test_pooled_scores_are_those_of_torchmetrics() -> None:
    maps = [_maps(seed) for seed in range(4)]
    scores = collection_scores([confusion_matrix(*one) for one in maps])
    truth = torch.from_numpy(np.concatenate([one[0].ravel() for one in maps]).astype(np.int64))
    predicted = torch.from_numpy(np.concatenate([one[1].ravel() for one in maps]).astype(np.int64))
    iou = MulticlassJaccardIndex(19, average=None, ignore_index=VOID)(predicted, truth)
    recall = MulticlassRecall(19, average=None, ignore_index=VOID)(predicted, truth)
    assert [one.iou.pooled for one in scores.classes] == pytest.approx(iou.tolist(), abs=1e-6)
    assert [one.pacc.pooled for one in scores.classes] == pytest.approx(recall.tolist(), abs=1e-6)
    assert scores.overall["miou"].pooled == pytest.approx(float(iou.mean()), abs=1e-6)


def test_frame_means_weigh_frames_and_pooled_weighs_pixels() -> None:
    person, road = PERSON.train_id, BY_NAME["road"].train_id
    small = np.full((4, 4), road, np.uint8)
    small[0, 0] = person  # one pixel, missed
    large = np.full((4, 4), person, np.uint8)  # sixteen, found
    matrices = [confusion_matrix(small, np.full_like(small, road)), confusion_matrix(large, large)]
    scores = collection_scores([*matrices, confusion_matrix(np.full_like(small, road), np.full_like(small, road))])
    pacc = scores.of(PERSON).pacc
    assert (pacc.frames.mean, pacc.frames.minimum, pacc.frames.maximum) == (0.5, 0.0, 1.0)
    assert (pacc.frames.defined, pacc.frames.undefined) == (2, 1)
    assert pacc.pooled == 16 / 17
    assert scores.frames == 3


def test_a_class_that_is_only_predicted_counts_in_the_average_of_cityscapes_alone() -> None:
    truth = np.zeros((2, 4), np.uint8)
    predicted = truth.copy()
    predicted[0, 0] = 13
    scores = collection_scores([confusion_matrix(truth, predicted)])
    assert scores.overall["miou"].pooled == 7 / 8
    assert scores.overall["miou_cityscapes"].pooled == pytest.approx((7 / 8 + 0.0) / 2)


def test_nothing_labelled_is_undefined_and_not_zero() -> None:
    void = np.full((2, 2), VOID, np.uint8)
    document = collection_scores([confusion_matrix(void, void)]).as_document()
    assert document["overall"]["miou"]["pooled"] is None
    assert document["classes"]["person"]["pacc"]["frames"]["undefined"] == 1
