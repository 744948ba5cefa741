"""Makes scores: ground truth and prediction → counts per frame and per person, and the ratios that follow."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from valerie.db import results
from valerie.db.engine import reading
from valerie.db.products import Finished, Job
from valerie.errors import InferenceError
from valerie.labels import to_train_ids
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.instances import person_counts
from valerie.metrics.matrix import ConfusionMatrix
from valerie.metrics.scores import frame_scores
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.reading.capture import capture_of_job
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.reading.run_cache import RunCache
from valerie.rendering.base import GroundTruth
from valerie.storage import codecs


class EvaluateMaker:
    """Integer counting: the same result on every machine."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs = RunCache(context)
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        started = time.process_time()
        if job.prediction is None or job.sensor_index is None or job.function_index is None:
            raise InferenceError(f"product {job.digest} is no evaluation")
        run = self._runs.run(job.run_id)
        resolved = run.resolved
        card = pinned_card(run.pins, resolved.spec.functions[job.function_index])
        capture = capture_of_job(resolved, job)
        truth = capture.seen_truth(self._reader)
        prediction = self._reader.prediction(job.prediction)
        matrix = confusion_matrix(to_train_ids(truth.class_map), prediction)
        packed = codecs.encode_counts(matrix)
        persons = person_counts(truth, prediction)
        return Finished(
            digest=job.digest,
            bytes=len(packed),
            pixels=int(prediction.size),
            cpu_seconds=time.process_time() - started,
            score={"digest": job.digest, "confusion": packed, **_ratios(matrix, card.judged_ids)},
            person_scores=tuple(
                {"digest": job.digest, "instance_id": person.instance_id, **person.columns} for person in persons
            ),
            person_views=self._views(job, truth) if capture.distorted else (),
        )

    def _views(self, job: Job, truth: GroundTruth) -> tuple[dict[str, Any], ...]:
        """The rows of the frame's own truth with everything that is measured in pixels measured again."""
        with reading(self._context.engine) as connection:
            rows = [dict(row._mapping) for row in results.person_views(connection, job.truth)]  # noqa: SLF001  # public
        return tuple({**measured_again(row, truth), "truth": job.digest} for row in rows)


def _ratios(matrix: ConfusionMatrix, judged: Sequence[int]) -> dict[str, Any]:
    scores = frame_scores(matrix, classes=judged)
    return {**asdict(scores.counts), "pacc": scores.pacc, **scores.columns}
