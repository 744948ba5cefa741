from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

from valerie.analysis.comparison.before_after import VersionComparison, compare
from valerie.analysis.comparison.drawing import comparison_renderable, draw_comparison
from valerie.analysis.comparison.wording import change_sentence
from valerie.analysis.rows.pairing import aligned
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import InvalidInput
from valerie.labels import PERSON
from valerie.measures import MEASURES
from valerie.metrics.collection import CollectionScores, collection_scores

N = 40
DISTANCE = np.linspace(10.0, 49.0, N)


def table(function: str, pacc: np.ndarray, *, fp: int = 10, order: np.ndarray | None = None) -> EvaluationTable:
    """One person of 100 pixels per frame; every frame is a place of its own."""
    order = np.arange(N) if order is None else order
    tp = np.rint(100 * pacc).astype(int)[order]
    return EvaluationTable.from_columns(
        {
            **{measure.name: [None] * len(order) for measure in MEASURES},
            "run_id": ["r"] * len(order),
            "variant_index": order,
            "frame_id": [f"r.{i}.0.0" for i in order],
            "camera": [f"camera-{i % 2 + 1}" for i in order],
            "character": ["yellow" if i % 4 < 2 else "black" for i in order],
            "sensor": ["default"] * len(order),
            "function": [function] * len(order),
            "instance_id": [24_001] * len(order),
            "pixel_area": [100] * len(order),
            "occlusion_rate": [0.0] * len(order),
            "distance_m": DISTANCE[order],
            "tp": tp,
            "fn": 100 - tp,
            "pacc": tp / 100,
            "precision": tp / np.maximum(tp + fp, 1),
            "iou": tp / (100 + fp),
            "pixel_accuracy": [0.9] * len(order),
            "fp": [fp] * len(order),
            "scene.person-1.pos.x": order.astype(float),
        },
        {"scene.person-1.pos.x": "FLOAT"},
    )


def scores(tp: int, fp: int, road: int = 1000) -> CollectionScores:
    matrix = np.zeros((19, 20), np.int64)
    matrix[0, 0], matrix[0, PERSON.train_id] = road, fp
    matrix[PERSON.train_id, PERSON.train_id], matrix[PERSON.train_id, 0] = tp, 100 - tp
    return collection_scores([matrix])


@pytest.fixture(scope="module")
def comparison() -> VersionComparison:
    """The second version sees far persons better by 30 points and near ones worse by 20."""
    before = np.full(N, 0.6)
    after = np.where(DISTANCE >= 30, 0.9, 0.4)
    return compare(
        {"old": (table("old", before), scores(60, 10)), "new": (table("new", after, fp=40), scores(65, 400))},
        more_groups={"far": DISTANCE >= 30},
    )


def test_every_group_has_both_averages_of_both_versions(comparison: VersionComparison) -> None:
    everyone = comparison.groups[0]
    assert (everyone.name, everyone.persons, everyone.frames) == ("all persons", N, N)
    old, new = everyone.sides
    assert old.pacc_mean == old.pacc_pooled == pytest.approx(0.6)
    assert old.precision_pooled == pytest.approx(60 / 70)
    assert new.iou_mean == pytest.approx(np.where(DISTANCE >= 30, 90 / 140, 40 / 140).mean())
    assert (old.detected, new.detected) == (1.0, pytest.approx(float((DISTANCE >= 30).mean())))
    assert (old.false_pixels, new.false_pixels) == (10 * N, 40 * N)


def test_a_difference_is_paired_and_has_an_interval(comparison: VersionComparison) -> None:
    far = next(group for group in comparison.groups if group.name == "far")
    (difference,) = far.differences
    assert difference.mean == pytest.approx(0.3)
    # The same at every place; one unseen place among 21 may gain or lose as much as the mean score of 0.75.
    assert difference.high is not None
    assert difference.low == pytest.approx(0.6 - difference.high)
    assert difference.low == pytest.approx(0.3 - 0.75 * (1 - 0.025 ** (1 / 20)))
    assert (difference.places, difference.judgement) == (20, "better")
    names = [group.name for group in comparison.groups]
    assert {"distance 10–20 m", "character black", "camera camera-1"} <= set(names)


def test_changes_for_the_worse_are_listed_like_changes_for_the_better(comparison: VersionComparison) -> None:
    changes = comparison.changes(1)
    better, worse = ([change_sentence(change) for change in changes if sign * change.step > 0] for sign in (1, -1))
    assert any("far: mean pACC 60.0 → 90.0 % (+30.0 points" in line for line in better)
    assert any("distance 10–20 m: mean pACC 60.0 → 40.0 % (−20.0 points" in line for line in worse)
    assert any("class road: pooled IoU" in line for line in worse)
    assert any("person precision, pooled: 85.7 → " in line for line in worse)
    assert [abs(change.step) for change in changes] == sorted((abs(change.step) for change in changes), reverse=True)
    (document,) = comparison.as_document()["changes"].values()
    assert [one["step"] for one in document] == [change.step for change in changes]


def test_rows_are_matched_by_frame_and_person() -> None:
    old = table("old", np.full(N, 0.5))
    other = table("new", np.full(N, 0.5), order=np.arange(N - 1, 4, -1))
    first, second = aligned([old, other])
    assert len(first) == len(second) == N - 5
    assert first.arrow["frame_id"].to_pylist() == second.arrow["frame_id"].to_pylist()
    with pytest.raises(InvalidInput, match="other frames"):
        compare({"old": (old, scores(1, 1)), "new": (other, scores(1, 1))})


def test_one_version_cannot_be_compared() -> None:
    with pytest.raises(InvalidInput, match="two"):
        compare({"old": (table("old", np.full(N, 0.5)), scores(1, 1))})


def test_the_table_shows_every_version_and_both_lists(comparison: VersionComparison) -> None:
    sink = StringIO()
    Console(file=sink, width=160, color_system=None).print(comparison_renderable(comparison))
    text = sink.getvalue()
    assert "new, better:" in text
    assert "new, worse:" in text
    assert "+30.0 [+17, +43]" in text
    assert text.count("  old ") >= len(comparison.groups)


def test_the_picture_is_drawn(comparison: VersionComparison, tmp_path: Path) -> None:
    draw_comparison(comparison, tmp_path / "pictures" / "comparison.png", title="old and new")
    with Image.open(tmp_path / "pictures" / "comparison.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    assert pixels.shape[1] > 1000
    assert (pixels == [0x00, 0x72, 0xB2]).all(axis=2).any()  # the second version's colour


def shown(comparison: VersionComparison) -> str:
    sink = StringIO()
    Console(file=sink, width=200, color_system=None).print(comparison_renderable(comparison))
    return sink.getvalue()


def classed(*numeric_classes: str) -> VersionComparison:
    old = table("old", np.full(N, 0.5))
    versions = {"old": (old, scores(50, 1)), "new": (old, scores(50, 1))}
    return compare(versions, numeric_classes=numeric_classes)


def test_the_numeric_class_of_every_version_is_shown() -> None:
    alike, unlike = classed("torch-fp32", "torch-fp32"), classed("torch-fp32", "openvino-bf16")
    assert alike.as_document()["numeric_classes"] == ["torch-fp32", "torch-fp32"]
    assert "All ran as torch-fp32." in shown(alike)
    assert "Numeric classes differ" in shown(unlike)
    assert "old ran as torch-fp32; new ran as openvino-bf16" in shown(unlike)


def test_versions_are_compared_over_the_classes_that_all_are_judged_by() -> None:
    matrix = np.zeros((19, 20), np.int64)
    matrix[PERSON.train_id, PERSON.train_id], matrix[0, 19] = 100, 1000
    old = table("old", np.full(N, 1.0), fp=0)
    persons = collection_scores([matrix], [PERSON.train_id])
    comparison = compare({"old": (old, persons), "new": (old, persons)})
    assert comparison.judged_by == tuple(comparison.classes) == ("person",)
    assert comparison.overall["miou"] == ((1.0, 1.0), (1.0, 1.0))
    assert "person alone: mean / pooled" in shown(comparison)
    with pytest.raises(InvalidInput, match="other classes"):
        compare({"old": (old, persons), "new": (old, scores(100, 0))})
