import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from valerie.errors import InvalidInput
from valerie.metrics import scores
from valerie.metrics.confusion import confusion_matrix

PERSON = 11
MATRICES = arrays(np.int64, (19, 20), elements=st.integers(0, 50))


def matrix_of(cells: dict[tuple[int, int], int]) -> np.ndarray:
    matrix = np.zeros((19, 20), np.int64)
    for cell, count in cells.items():
        matrix[cell] = count
    return matrix


def detectron2_scores(matrix: np.ndarray) -> dict[str, float]:
    """Return the scores by the arithmetic of SemSegEvaluator: rows prediction, columns truth, no predicted void."""
    conf = matrix[:, :19].T.astype(float)
    tp, gt, pred = conf.diagonal(), conf.sum(axis=0), conf.sum(axis=1)
    acc, iou = [], []
    fwiou = 0.0
    for k in range(19):
        if gt[k] > 0:
            acc.append(tp[k] / gt[k])
            iou.append(tp[k] / (gt[k] + pred[k] - tp[k]))
            fwiou += iou[-1] * gt[k] / gt.sum()
    return {
        "macc": sum(acc) / len(acc),
        "miou": sum(iou) / len(iou),
        "fwiou": fwiou,
        "pixel_accuracy": tp.sum() / gt.sum(),
    }


def test_hand_computed_scores_of_a_three_by_three_image() -> None:
    truth = np.array([[11, 11, 0], [11, 0, 0], [255, 255, 0]], np.uint8)
    predicted = np.array([[11, 0, 0], [11, 11, 0], [11, 0, 0]], np.uint8)
    result = scores.frame_scores(confusion_matrix(truth, predicted))
    assert result.counts == scores.ClassCounts(tp=2, fp=1, fn=1, tn=3)
    assert result.pacc == pytest.approx(2 / 3)
    assert result.precision == pytest.approx(2 / 3)
    assert result.iou == pytest.approx(1 / 2)
    assert result.pixel_accuracy == pytest.approx(5 / 7)
    assert result.macc == pytest.approx((2 / 3 + 3 / 4) / 2)
    assert result.miou == pytest.approx((1 / 2 + 3 / 5) / 2)
    assert result.fwiou == pytest.approx(1 / 2 * 3 / 7 + 3 / 5 * 4 / 7)
    assert result.undefined == {}


@given(MATRICES)
def test_scores_over_all_classes_equal_those_of_detectron2_without_predicted_void(matrix: np.ndarray) -> None:
    matrix[:, 19] = 0
    matrix[0, 0] += 1
    for name, expected in detectron2_scores(matrix).items():
        assert getattr(scores, name)(matrix) == pytest.approx(expected)


@pytest.mark.parametrize("name", ["miou", "macc", "pixel_accuracy"])
def test_torchmetrics_agrees_when_every_class_is_present(name: str) -> None:
    torch = pytest.importorskip("torch")
    from torchmetrics.functional.classification import multiclass_accuracy, multiclass_jaccard_index

    rng = np.random.default_rng(0)
    truth = rng.integers(0, 19, (64, 64)).astype(np.uint8)
    predicted = np.where(rng.random((64, 64)) < 0.6, truth, rng.integers(0, 19, (64, 64))).astype(np.uint8)
    maps = (torch.from_numpy(predicted.astype(int)), torch.from_numpy(truth.astype(int)))
    oracle = {
        "miou": lambda: multiclass_jaccard_index(*maps, 19),
        "macc": lambda: multiclass_accuracy(*maps, 19, average="macro"),
        "pixel_accuracy": lambda: multiclass_accuracy(*maps, 19, average="micro"),
    }[name]()
    assert getattr(scores, name)(confusion_matrix(truth, predicted)) == pytest.approx(float(oracle), abs=1e-6)


def test_a_class_that_is_absent_from_the_truth_is_left_out_of_the_means_even_when_predicted() -> None:
    matrix = matrix_of({(0, 0): 6, (0, 5): 2})
    assert scores.macc(matrix) == pytest.approx(6 / 8)
    assert scores.miou(matrix) == pytest.approx(6 / 8)


@given(MATRICES)
def test_with_one_class_macc_is_pacc_and_miou_is_fwiou(matrix: np.ndarray) -> None:
    counts = scores.class_counts(matrix, PERSON)
    assert scores.macc(matrix, [PERSON]) == scores.pixel_accuracy(matrix, [PERSON]) == scores.pacc(counts.tp, counts.fn)
    assert scores.miou(matrix, [PERSON]) == scores.fwiou(matrix, [PERSON])
    if counts.tp + counts.fn:
        assert scores.miou(matrix, [PERSON]) == scores.iou(counts.tp, counts.fp, counts.fn)


@given(MATRICES, st.integers(0, 18))
def test_the_four_counts_cover_every_labelled_pixel_once(matrix: np.ndarray, train_id: int) -> None:
    counts = scores.class_counts(matrix, train_id)
    assert counts.tp + counts.fp + counts.fn + counts.tn == matrix.sum()
    assert min(counts.tp, counts.fp, counts.fn, counts.tn) >= 0


def test_a_void_prediction_on_a_person_is_a_miss() -> None:
    matrix = matrix_of({(PERSON, PERSON): 3, (PERSON, 19): 1})
    result = scores.frame_scores(matrix)
    assert result.pacc == pytest.approx(3 / 4)
    assert result.precision == 1.0
    assert result.iou == pytest.approx(3 / 4)


def test_counts_of_a_class_give_the_rates_of_the_definitions() -> None:
    counts = scores.ClassCounts(tp=7, fp=3, fn=14, tn=100)
    assert (counts.pacc, counts.precision, counts.iou) == (7 / 21, 7 / 10, 7 / 24)
    nothing = scores.ClassCounts(tp=0, fp=0, fn=0, tn=5)
    assert (nothing.pacc, nothing.precision, nothing.iou) == (None, None, None)


def test_painting_everything_person_has_full_pacc_and_poor_precision() -> None:
    result = scores.frame_scores(matrix_of({(PERSON, PERSON): 10, (0, PERSON): 990}))
    assert result.pacc == 1.0
    assert result.precision == pytest.approx(0.01)


def test_a_frame_without_persons_has_an_undefined_pacc_with_a_reason() -> None:
    result = scores.frame_scores(matrix_of({(0, 0): 10}))
    assert result.pacc is None
    assert result.undefined == {
        "pacc": scores.NOT_IN_TRUTH,
        "precision": scores.NOT_PREDICTED,
        "iou": scores.IN_NEITHER,
    }


def test_a_false_alarm_on_a_frame_without_persons_has_precision_zero_and_no_pacc() -> None:
    result = scores.frame_scores(matrix_of({(0, PERSON): 10}))
    assert (result.pacc, result.precision, result.iou) == (None, 0.0, 0.0)


def test_a_person_missed_altogether_has_pacc_zero_and_no_precision() -> None:
    result = scores.frame_scores(matrix_of({(PERSON, 0): 10}))
    assert (result.pacc, result.precision, result.iou) == (0.0, None, 0.0)


def test_an_unlabelled_frame_has_no_score_at_all() -> None:
    result = scores.frame_scores(matrix_of({}))
    assert set(result.undefined) == {"pacc", "precision", "iou", "pixel_accuracy", "macc", "miou", "fwiou"}


@pytest.mark.parametrize("classes", [[19], [-1], [3, 3]])
def test_wrong_classes_are_refused(classes: list[int]) -> None:
    with pytest.raises(InvalidInput, match="classes"):
        scores.miou(matrix_of({}), classes)


def test_a_matrix_of_another_shape_is_refused() -> None:
    with pytest.raises(InvalidInput, match="confusion matrix"):
        scores.frame_scores(np.zeros((19, 19), np.int64))
