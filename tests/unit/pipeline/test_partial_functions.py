"""A function that knows fewer than the 19 classes, from its registration to summary, report and address of its scores."""

from __future__ import annotations

import numpy as np
import orjson
import pytest
from sqlalchemy import select

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.analysis.findings.findings import Findings
from valerie.analysis.summary.summary import Summary
from valerie.analysis.summary.text import summary_text
from valerie.db import results
from valerie.db.engine import reading
from valerie.db.models import Frame
from valerie.errors import Conflict
from valerie.labels import PERSON, VOID
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import parse_function
from valerie.perception.running.label_png import encode_png
from valerie.pipeline.functions import registry
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.retraining.comparison import compare_on_run
from valerie.pipeline.retraining.dataset_evaluation import run_side
from valerie.pipeline.work.uploaded_predictions import put_prediction
from valerie.plain import typed
from valerie.runs.products.frame_keys import FrameKey
from valerie.storage.keys import run_key

PERSON_OR_NOT = (
    "name: person-or-not\nkind: predictions\n"
    "output: {kind: labels, classes: [other, human], class_map: {human: person}}\n"
)
NARROWED = "name: narrowed\nkind: predictions\noutput: {kind: labels, target_classes: [person]}\n"
RUN = spec(xs=2, ys=2, functions=["person-or-not", "narrowed", "blank"])


@pytest.fixture
def finished(pipeline: Pipeline) -> tuple[Pipeline, str]:
    """One function that finds every person and knows nothing else; one that knows more and is asked for persons alone."""
    for text in (PERSON_OR_NOT, NARROWED):
        registry.register(pipeline.context, parse_function(text), None)
    run = pipeline.submit(RUN)
    assert pipeline.run(run, until=["running"]) == "running"
    for _ in range(8):
        pipeline.step()
    with reading(pipeline.context.engine) as connection:
        frames = connection.execute(select(Frame.variant_index, Frame.camera_index, Frame.truth)).all()
    assert len(frames) == 8
    reader = ProductReader(pipeline.context.store)
    for variant, camera, truth in frames:
        person = reader.truth(truth).class_map == PERSON.id
        for name, ids in (
            ("person-or-not", person.astype(np.uint8)),
            ("narrowed", np.where(person, PERSON.train_id, VOID).astype(np.uint8)),
        ):
            put_prediction(pipeline.context, FrameKey(run, variant, camera), encode_png(ids), function=name)
    assert pipeline.run(run) == "completed"
    return pipeline, run


def test_a_perfect_person_or_not_is_perfect_in_every_figure(finished: tuple[Pipeline, str]) -> None:
    pipeline, run = finished
    with reading(pipeline.context.engine) as connection:
        evaluations = results.frame_evaluations(connection, FrameKey(run, 0, 0))
    perfect, narrowed, blank = (evaluation.score.figures for evaluation in evaluations)
    figures = ("pacc", "precision", "iou", "pixel_accuracy", "miou", "fwiou", "macc")
    assert {name: perfect[name] for name in figures} == dict.fromkeys(figures, 1.0)
    assert {name: narrowed[name] for name in figures} == dict.fromkeys(figures, 1.0)
    assert blank["pixel_accuracy"] < 1.0, "it is judged by all classes"

    summary = orjson.loads(pipeline.context.store.get(run_key(run, "summary.json")))
    text = summary_text(typed(Summary, summary["summary"]), typed(Findings, summary["findings"]))
    both = "person-or-not 100.0 / 100.0, narrowed 100.0 / 100.0"
    assert f"Mean IoU of person alone, frame mean / pooled: {both}." in text
    assert "Mean IoU of all classes, frame mean / pooled: blank " in text
    report = pipeline.context.store.get(run_key(run, "report.html")).decode()
    assert "person-or-not is judged by person alone." in report
    assert "blank is judged by" not in report

    side = run_side(pipeline.context, run, "person-or-not").scores.as_document()
    assert side["judged_by"] == ["person"]
    assert side["overall"]["miou"]["pooled"] == side["overall"]["pixel_accuracy"]["frames"]["mean"] == 1.0


def test_it_is_compared_with_others_by_what_it_knows(finished: tuple[Pipeline, str]) -> None:
    pipeline, run = finished

    def nothing(reference: str) -> PerceptionFunction:
        raise AssertionError(f"{reference} is stored")

    versions = ["blank", "person-or-not"]
    with pytest.raises(Conflict, match="blank ran as blank; person-or-not ran as uploaded"):
        compare_on_run(pipeline.context, run, versions, open_function=nothing)
    comparison = compare_on_run(pipeline.context, run, versions, open_function=nothing, mixed=True)
    assert comparison.judged_by == tuple(comparison.classes) == ("person",)
    before, after = comparison.overall["miou"]
    assert before[1] is not None
    assert before[1] < 1.0
    assert after == (1.0, 1.0)
