"""Uploaded predictions: awaited, checked, published once, given up at the deadline."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db.engine import reading, writing
from valerie.db.runs import set_values
from valerie.errors import Conflict, InvalidInput, NotFound, UnknownName
from valerie.perception.documents.function import parse_function
from valerie.perception.running.label_png import encode_png
from valerie.pipeline.base.deadlines import deadlines
from valerie.pipeline.control import lifecycle, monitoring
from valerie.pipeline.control.diagnosis import diagnose
from valerie.pipeline.functions import registry
from valerie.pipeline.reading.frame_pictures import find_picture
from valerie.pipeline.work.uploaded_predictions import put_prediction
from valerie.runs.products.frame_keys import FrameKey
from valerie.storage.codecs import decode_prediction
from valerie.storage.keys import product_key

TEXT = "name: mine\nkind: predictions\noutput: {classes: [street, person], class_map: {street: road}}\n"
FRAMES = [(variant, camera) for variant in range(4) for camera in range(2)]


def label_map(value: int = 1) -> NDArray[np.uint8]:
    ids = np.zeros((36, 64), np.uint8)
    ids[10:20, 20:30] = value
    return ids


@pytest.fixture
def waiting(pipeline: Pipeline) -> tuple[Pipeline, str]:
    """A run of 8 frames whose predictions are to be uploaded."""
    registry.register(pipeline.context, parse_function(TEXT), None)
    run = pipeline.submit(spec(xs=2, ys=2, functions=["mine", "blank"]))
    assert pipeline.run(run, until=["running"]) == "running"
    for _ in range(8):
        pipeline.step()
    return pipeline, run


def put(pipeline: Pipeline, run: str, place: tuple[int, int] = (0, 0), ids: NDArray[np.uint8] | None = None) -> bool:
    data = encode_png(label_map() if ids is None else ids)
    return put_prediction(pipeline.context, FrameKey(run, *place), data)


def test_the_run_says_what_it_waits_for_and_sends_no_message(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    row = pipeline.row(run)
    assert row.state == "running"
    assert row.reason.startswith("awaiting-predictions: 8 predictions are to be uploaded by ")
    assert row.progress.awaiting == 8
    assert row.progress.stages["infer"].done == 8, "those of the other function"
    assert pipeline.broker.queue_lengths(["infer.uploaded"]) == {"infer.uploaded": 0}


def test_no_worker_is_called_for(waiting: tuple[Pipeline, str]) -> None:
    pipeline, _ = waiting
    assert "infer.uploaded" not in {queue.route for queue in monitoring.queues(pipeline.context)}
    assert "infer.uploaded" not in monitoring.metrics(pipeline.context)
    assert not any("valerie worker" in check.remedy for check in diagnose(pipeline.context))


def test_it_ends_with_results_when_all_are_uploaded(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    assert all(put(pipeline, run, place) for place in FRAMES)
    assert pipeline.run(run) == "completed"
    with reading(pipeline.context.engine):
        source = find_picture(pipeline.context, FrameKey(run, 0, 0), kind="prediction", function="mine")
    assert source.prediction is not None
    stored = decode_prediction(pipeline.context.store.get(product_key("prediction", source.prediction)))
    expected = np.where(label_map() == 1, 11, 0)  # train ids of person and road
    np.testing.assert_array_equal(stored, expected)


def test_the_same_again_changes_nothing_and_another_is_refused(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    assert put(pipeline, run)
    assert not put(pipeline, run)
    with pytest.raises(Conflict, match="this frame already has another prediction"):
        put(pipeline, run, ids=np.zeros((36, 64), np.uint8))


def test_another_run_of_the_same_frames_and_version_has_them_already(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    for place in FRAMES:
        put(pipeline, run, place)
    pipeline.run(run)
    assert pipeline.run(pipeline.submit(spec(xs=2, ys=2, name="again", functions=["mine"]))) == "completed"


def test_void_is_an_id_of_every_function(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    assert put(pipeline, run, ids=label_map(255))


@pytest.mark.parametrize(
    ("ids", "message"),
    [
        (label_map(7), r"an id without a class; got 7; limit: 0…1 as mine declares its classes, or 255 for void"),
        (np.zeros((36, 63), np.uint8), "another size than the frame's; got 63 × 36; limit: 64 × 36"),
        (np.zeros((36, 64, 3), np.uint8), "a pixel must be one byte"),
    ],
)
def test_what_is_no_label_map_of_the_frame_is_refused(
    waiting: tuple[Pipeline, str], ids: NDArray[np.uint8], message: str
) -> None:
    pipeline, run = waiting
    with pytest.raises(InvalidInput, match=message):
        put(pipeline, run, ids=ids)


def test_what_does_not_exist_is_told(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    data = encode_png(label_map())
    with pytest.raises(NotFound, match="there is no frame"):
        put(pipeline, run, (99, 0))
    with pytest.raises(UnknownName, match="unknown function 'mien'; did you mean mine"):
        put_prediction(pipeline.context, FrameKey(run, 0, 0), data, function="mien")
    with pytest.raises(UnknownName, match="unknown sensor"):
        put_prediction(pipeline.context, FrameKey(run, 0, 0), data, sensor="dusk")


def test_a_run_that_waits_for_nobody_says_so(pipeline: Pipeline) -> None:
    run = pipeline.submit(spec(xs=2, ys=2))
    pipeline.run(run)
    with pytest.raises(Conflict, match="is not waiting for predictions"):
        put(pipeline, run)


def test_a_frame_that_is_not_rendered_yet_cannot_have_one(pipeline: Pipeline) -> None:
    registry.register(pipeline.context, parse_function(TEXT), None)
    run = pipeline.submit(spec(xs=2, ys=2, functions=["mine"]))
    pipeline.loop.tick()
    with pytest.raises(Conflict, match="the frame is not rendered yet"):
        put(pipeline, run)


def test_a_run_that_was_cancelled_takes_none(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    lifecycle.cancel(pipeline.context, run)
    with pytest.raises(Conflict, match="no running run waits for this prediction"):
        put(pipeline, run)


def expire(pipeline: Pipeline, run: str) -> None:
    pins = pipeline.row(run).pins
    mine = pins.functions["mine"].model_copy(update={"deadline": time.time() - 1})
    pins = pins.model_copy(update={"functions": {**pins.functions, "mine": mine}})
    with writing(pipeline.context.engine) as connection:
        set_values(connection, run, pins=pins)


def test_what_is_missing_at_the_deadline_is_a_recorded_failure(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    put(pipeline, run)
    expire(pipeline, run)
    assert pipeline.run(run) == "completed-with-failures"
    errors = [
        product.error
        for product in pipeline.products()
        if product.route == "infer.uploaded" and product.state == "failed"
    ]
    assert len(errors) == len(FRAMES) - 1
    assert all(error.message.startswith("no prediction by 20") for error in errors)


def test_a_retry_gives_the_time_again(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    expire(pipeline, run)
    pipeline.run(run)
    lifecycle.retry(pipeline.context, run)
    for _ in range(3):
        pipeline.step()
    assert pipeline.row(run).progress.awaiting == 8
    assert all(put(pipeline, run, place) for place in FRAMES)
    assert pipeline.run(run) == "completed"


def test_another_run_may_still_wait_when_ones_deadline_has_passed(waiting: tuple[Pipeline, str]) -> None:
    pipeline, run = waiting
    other = pipeline.submit(spec(xs=2, ys=2, name="patient", functions=["mine"]))
    for _ in range(3):
        pipeline.step()
    expire(pipeline, run)
    pipeline.step()
    assert pipeline.row(other).progress.awaiting == 8
    for place in FRAMES:
        put(pipeline, other, place)
    assert pipeline.run(run) == pipeline.run(other) == "completed"


def test_the_document_may_set_another_deadline_than_the_deployment(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(predictions_hours=48)
    registry.register(pipeline.context, parse_function(TEXT), None)
    registry.register(
        pipeline.context, parse_function(TEXT.replace("mine", "soon") + "options: {deadline_hours: 2}"), None
    )
    run = pipeline.submit(spec(xs=2, ys=2, functions=["mine", "soon"]))
    pipeline.step()
    hours = {name: (deadline - time.time()) / 3600 for name, deadline in deadlines(pipeline.row(run).pins).items()}
    assert 47.9 < hours["mine"] < 48.1
    assert 1.9 < hours["soon"] < 2.1


def test_frames_that_wait_for_people_do_not_hold_up_the_rest_of_a_large_run(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(feed_window=600)
    registry.register(pipeline.context, parse_function(TEXT), None)
    run = pipeline.submit(spec(xs=26, ys=10, functions=["mine"]))
    for _ in range(10):
        pipeline.step()
    assert pipeline.row(run).progress.awaiting == 520
