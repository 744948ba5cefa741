from dataclasses import fields

import numpy as np
import pytest
import torch
from sklearn.metrics import jaccard_score, recall_score
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
    assert scores.overall.miou.pooled == pytest.approx(float(iou.mean()), abs=1e-6)


def test_frame_means_weight_frames_equally_and_pooled_scores_weight_pixels_equally() -> None:
    person, road = PERSON.train_id, BY_NAME["road"].train_id
    small = np.full((4, 4), road, np.uint8)
    small[0, 0] = person  # one pixel, a miss
    large = np.full((4, 4), person, np.uint8)  # sixteen pixels, all correct
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
    assert scores.overall.miou.pooled == 7 / 8
    assert scores.overall.miou_cityscapes.pooled == pytest.approx((7 / 8 + 0.0) / 2)


def test_without_labelled_pixels_scores_are_undefined_and_not_zero() -> None:
    void = np.full((2, 2), VOID, np.uint8)
    document = collection_scores([confusion_matrix(void, void)]).as_document()
    assert document["overall"]["miou"]["pooled"] is None
    assert document["classes"]["person"]["pacc"]["frames"]["undefined"] == 1


def test_scores_of_some_classes_are_those_of_scikit_learn_over_their_labels() -> None:
    maps = [_maps(seed) for seed in range(3)]
    judged = [0, 11, 13]
    scores = collection_scores([confusion_matrix(*one) for one in maps], judged)
    truth, predicted = (np.concatenate([one[side].ravel() for one in maps]) for side in (0, 1))
    truth, predicted = truth[truth != VOID], predicted[truth != VOID]
    ious = jaccard_score(truth, predicted, labels=judged, average=None)
    assert scores.overall.miou.pooled == pytest.approx(ious.mean())
    assert scores.overall.miou_cityscapes.pooled == pytest.approx(ious.mean())
    assert scores.overall.macc.pooled == pytest.approx(recall_score(truth, predicted, labels=judged, average="macro"))
    weighted = jaccard_score(truth, predicted, labels=judged, average="weighted")
    assert scores.overall.fwiou.pooled == pytest.approx(weighted)
    of_them = np.isin(truth, judged)
    right = (truth == predicted)[of_them].mean()
    assert scores.overall.pixel_accuracy.pooled == pytest.approx(right)
    document = scores.as_document()
    assert document["judged_by"] == list(document["classes"]) == ["road", "person", "car"]
    assert np.sum(document["confusion"]) == len(truth), "what was counted stays whole"


def test_a_function_that_knows_persons_alone_may_predict_void_but_not_person_elsewhere() -> None:
    truth, _ = _maps(1)
    person = PERSON.train_id
    perfect = collection_scores([confusion_matrix(truth, np.where(truth == person, truth, VOID))], [person])
    averages = [getattr(perfect.overall, field.name) for field in fields(perfect.overall)]
    assert [average.pooled for average in averages] == [1.0] * 5
    painted = collection_scores([confusion_matrix(truth, np.full_like(truth, person))], [person])
    share = (truth == person).sum() / (truth != VOID).sum()
    assert painted.overall.miou.pooled == painted.overall.fwiou.frames.mean == pytest.approx(share)
    assert painted.overall.pixel_accuracy.pooled == painted.of(PERSON).pacc.pooled == 1.0


def test_all_classes_by_name_are_all_classes_to_the_last_digit() -> None:
    matrices = [confusion_matrix(*_maps(seed)) for seed in range(3)]
    assert collection_scores(matrices, range(19)).as_document() == collection_scores(matrices).as_document()
