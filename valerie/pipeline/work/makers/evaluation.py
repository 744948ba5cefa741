"""Scores of predictions: counts per frame and per person, and their ratios."""

from __future__ import annotations

import time

from valerie.db import measured
from valerie.db.archives import reading_run
from valerie.db.claiming import Job
from valerie.db.measured import FrameScore, MeasuredPerson, SeenPerson
from valerie.db.publishing import Finished
from valerie.errors import InferenceError
from valerie.metrics.scoring import score_frame
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pinning import pinned_card
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import GroundTruth
from valerie.storage import codecs


class EvaluateMaker:
    """Maker that scores predictions by counting pixels, with the same result on every machine."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        started = time.process_time()
        if job.look is None:
            raise InferenceError(f"product {job.digest} is not an evaluation")
        run = started_run(self._context, job.frame.key.run_id)
        resolved = run.resolved
        card = pinned_card(run.pins, resolved.spec.functions[job.look.function])
        capture = capture_of(resolved, job.frame, job.look.sensor)
        truth = capture.seen_truth(self._reader)
        prediction = self._reader.prediction(job.look.prediction)
        empty = None if job.look.empty is None else self._reader.prediction(job.look.empty)
        scored = score_frame(truth, prediction, card.judged_ids, empty=empty)
        counts = codecs.encode_counts(scored.matrix)
        return Finished(
            digest=job.digest,
            bytes=len(counts),
            pixels=int(prediction.size),
            cpu_seconds=time.process_time() - started,
            score=FrameScore(
                confusion=counts,
                tp=scored.scores.counts.tp,
                fn=scored.scores.counts.fn,
                tn=scored.scores.counts.tn,
                pacc=scored.scores.pacc,
                measures=scored.scores.measures,
            ),
            person_scores=tuple(MeasuredPerson(person.instance_id, person.measures) for person in scored.persons),
            person_views=self._views(job, truth) if capture.distorted else (),
        )

    def _views(self, job: Job, truth: GroundTruth) -> tuple[SeenPerson, ...]:
        """Return the persons of the frame's own truth with all pixel measures from the distorted truth."""
        with reading_run(self._context.engine, job.frame.key.run_id) as connection:
            persons = measured.person_views(connection, job.frame.products.truth)
        return tuple(measured_again(person, truth) for person in persons)
