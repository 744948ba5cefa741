"""Makes scores: ground truth and prediction → counts per frame and per person, and the ratios that follow."""

from __future__ import annotations

import time
from typing import Any

from valerie.db.products import Finished, Job
from valerie.errors import InferenceError
from valerie.labels import to_train_ids
from valerie.metrics.confusion import ConfusionMatrix, confusion_matrix
from valerie.metrics.instances import person_counts
from valerie.metrics.scores import frame_scores, pacc
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inputs import ProductReader
from valerie.storage import codecs


class EvaluateMaker:
    """Integer counting: the same result on every machine."""

    def __init__(self, context: Context) -> None:
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.stages.Maker`."""
        started = time.process_time()
        if job.prediction is None:
            raise InferenceError(f"product {job.digest} is no evaluation")
        truth = self._reader.truth(job.truth)
        prediction = self._reader.prediction(job.prediction)
        matrix = confusion_matrix(to_train_ids(truth.class_map), prediction)
        packed = codecs.encode_counts(matrix)
        persons = person_counts(truth, prediction)
        return Finished(
            digest=job.digest,
            bytes=len(packed),
            pixels=int(prediction.size),
            cpu_seconds=time.process_time() - started,
            score={"digest": job.digest, "confusion": packed, **_ratios(matrix)},
            person_scores=tuple(
                {
                    "digest": job.digest,
                    "instance_id": person.instance_id,
                    "tp": person.tp,
                    "fn": person.fn,
                    "pacc": pacc(person.tp, person.fn),
                }
                for person in persons
            ),
        )


def _ratios(matrix: ConfusionMatrix) -> dict[str, Any]:
    scores = frame_scores(matrix)
    return {
        "tp": scores.counts.tp,
        "fp": scores.counts.fp,
        "fn": scores.counts.fn,
        "tn": scores.counts.tn,
        "pacc": scores.pacc,
        "precision": scores.precision,
        "iou": scores.iou,
        "pixel_accuracy": scores.pixel_accuracy,
        "miou": scores.miou,
        "fwiou": scores.fwiou,
        "macc": scores.macc,
    }
