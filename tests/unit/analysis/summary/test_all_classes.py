import json
from dataclasses import asdict

import numpy as np
import pytest

from valerie.analysis.rows.table import EvaluationTable
from valerie.analysis.summary.all_classes import AllClasses, all_classes
from valerie.analysis.summary.summary import Summary, summarize
from valerie.analysis.summary.text import summary_text
from valerie.analysis.wording import classes_text
from valerie.labels import PERSON
from valerie.metrics.aggregate import FrameMean, frame_mean
from valerie.metrics.collection import collection_scores
from valerie.plain import typed

ROAD, SKY = 0, 10


@pytest.fixture
def net() -> AllClasses:
    """100 pixels of road, 90 correct and 10 predicted as person; 40 of person, 20 correct, 15 predicted as road, 5 as void."""
    matrix = np.zeros((19, 20), np.int64)
    matrix[ROAD, ROAD], matrix[ROAD, PERSON.train_id] = 90, 10
    matrix[PERSON.train_id, PERSON.train_id], matrix[PERSON.train_id, ROAD], matrix[PERSON.train_id, 19] = 20, 15, 5
    return all_classes("net", "default", matrix, frame_mean([0.5, None, 0.7]))


def test_scores_follow_from_the_summed_counts(net: AllClasses) -> None:
    road, person = net.classes
    assert (road.name, road.pixels, person.name, person.pixels) == ("road", 100, "person", 40)
    assert (road.pacc, road.precision, road.iou) == pytest.approx((0.9, 90 / 105, 90 / 115))
    assert (person.pacc, person.precision, person.iou) == pytest.approx((0.5, 20 / 30, 20 / 50))
    assert net.miou_pooled == pytest.approx((90 / 115 + 20 / 50) / 2)
    assert net.pixel_accuracy_pooled == pytest.approx(110 / 140)
    assert (net.frames, net.miou_mean) == (3, pytest.approx(0.6))


def test_a_class_that_is_only_predicted_is_left_out() -> None:
    matrix = np.zeros((19, 20), np.int64)
    matrix[ROAD, ROAD], matrix[ROAD, SKY] = 3, 1
    assert [one.name for one in all_classes("net", "default", matrix, frame_mean([])).classes] == ["road"]


def test_without_a_labelled_pixel_all_scores_are_undefined() -> None:
    net = all_classes("net", "default", np.zeros((19, 20), np.int64), FrameMean(None, None, None, 0, 2))
    assert (net.frames, net.miou_pooled, net.miou_mean, net.classes) == (2, None, None, ())


def test_scores_equal_those_of_a_collection_of_the_same_frames_to_the_last_digit() -> None:
    matrices = list(np.random.default_rng(3).integers(0, 999, (4, 19, 20)))
    net = all_classes("net", "default", sum(matrices), frame_mean([]))
    for one, other in zip(net.classes, collection_scores(matrices).classes, strict=True):
        assert (one.name, one.pixels) == (other.label.name, other.counts.tp + other.counts.fn)
        assert (one.pacc, one.precision, one.iou) == (other.pacc.pooled, other.precision.pooled, other.iou.pooled)


def test_the_text_gives_both_averages(net: AllClasses) -> None:
    text = summary_text(summarize(EvaluationTable.from_rows([], {}), classes=[net]))
    assert "Mean IoU of all classes, frame mean / pooled: net 60.0 / 59.1." in text


def test_a_summary_with_classes_survives_json_and_one_without_is_read(net: AllClasses) -> None:
    summary = summarize(EvaluationTable.from_rows([], {}), classes=[net])
    document = json.loads(json.dumps(asdict(summary)))
    assert typed(Summary, document) == summary
    del document["classes"]
    assert typed(Summary, document).classes == ()


@pytest.fixture
def person_only() -> AllClasses:
    """All 40 pixels of person correct, 10 of 100 pixels of road predicted as person, void elsewhere."""
    matrix = np.zeros((19, 20), np.int64)
    matrix[ROAD, 19], matrix[ROAD, PERSON.train_id] = 90, 10
    matrix[PERSON.train_id, PERSON.train_id] = 40
    return all_classes("person-or-not", "default", matrix, frame_mean([0.8]), ("person",))


def test_a_function_is_judged_by_the_classes_that_it_knows(person_only: AllClasses) -> None:
    road, person = person_only.classes
    assert (road.pixels, road.pacc, road.precision, road.iou) == (100, None, None, None)
    assert person.iou == person_only.miou_pooled == pytest.approx(0.8)
    assert person.pacc == person_only.pixel_accuracy_pooled == 1.0


def test_the_text_lists_means_over_different_classes_separately(net: AllClasses, person_only: AllClasses) -> None:
    text = summary_text(summarize(EvaluationTable.from_rows([], {}), classes=[net, person_only]))
    assert "Mean IoU of all classes, frame mean / pooled: net 60.0 / 59.1." in text
    assert "Mean IoU of person alone, frame mean / pooled: person-or-not 80.0 / 80.0." in text


def test_judged_classes_survive_json(person_only: AllClasses) -> None:
    summary = summarize(EvaluationTable.from_rows([], {}), classes=[person_only])
    assert typed(Summary, json.loads(json.dumps(asdict(summary)))) == summary


@pytest.mark.parametrize(
    ("judged_by", "text"),
    [
        ((), "all classes"),
        (("person",), "person alone"),
        (("road", "person"), "road and person"),
        (("road", "person", "car"), "road, person and car"),
        (("road", "sky", "person", "rider", "car"), "5 of the 19 classes"),
    ],
)
def test_a_few_judged_classes_are_named_and_many_are_counted(judged_by: tuple[str, ...], text: str) -> None:
    assert classes_text(judged_by) == text
