"""Scores of predictions: counts per frame and per person, and the ratios that follow."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

from valerie.db import results
from valerie.db.engine import reading
from valerie.db.products import Finished, Job
from valerie.errors import InferenceError
from valerie.metrics.scores import FrameScores
from valerie.metrics.scoring import score_frame
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pins import pinned_card
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.reading.run_cache import RunCache
from valerie.rendering.base import GroundTruth
from valerie.storage import codecs


class EvaluateMaker:
    """Scores predictions by counting pixels, with the same result on every machine."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs = RunCache(context)
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        started = time.process_time()
        if job.look is None:
            raise InferenceError(f"product {job.digest} is not an evaluation")
        run = self._runs.run(job.frame.key.run_id)
        resolved = run.resolved
        card = pinned_card(run.pins, resolved.spec.functions[job.look.function])
        capture = capture_of(resolved, job.frame, job.look.sensor)
        truth = capture.seen_truth(self._reader)
        prediction = self._reader.prediction(job.look.prediction)
        scored = score_frame(truth, prediction, card.judged_ids)
        packed = codecs.encode_counts(scored.matrix)
        return Finished(
            digest=job.digest,
            bytes=len(packed),
            pixels=int(prediction.size),
            cpu_seconds=time.process_time() - started,
            score={"digest": job.digest, "confusion": packed, **_columns(scored.scores)},
            person_scores=tuple(
                {"digest": job.digest, "instance_id": person.instance_id, **person.columns} for person in scored.persons
            ),
            person_views=self._views(job, truth) if capture.distorted else (),
        )

    def _views(self, job: Job, truth: GroundTruth) -> tuple[dict[str, Any], ...]:
        """Return the rows of the frame's own truth with everything in pixels measured again."""
        with reading(self._context.engine) as connection:
            rows = [dict(row._mapping) for row in results.person_views(connection, job.frame.products.truth)]  # noqa: SLF001  # public
        return tuple({**measured_again(row, truth), "truth": job.digest} for row in rows)


def _columns(scores: FrameScores) -> dict[str, Any]:
    return {**asdict(scores.counts), "pacc": scores.pacc, **scores.columns}
