"""Replay of one frame: it is computed again in this process and compared with the stored products, byte for byte."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from obstore.store import MemoryStore

from valerie.db import frames, measured, results, runs
from valerie.db.archives import reading_run
from valerie.db.claiming import EvaluationLink, Job
from valerie.db.frames import AnnotationLink
from valerie.db.measured import FrameScore
from valerie.db.publishing import Finished
from valerie.db.results import FrameEvaluation
from valerie.errors import MissingInput, NotFound, ValerieError
from valerie.measures import Cell
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.pipeline.work.stages import Maker
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import ProductKind, ProductState
from valerie.storage import codecs
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore


@dataclass(frozen=True, slots=True)
class Replayed:
    """One replayed product of the frame.

    Attributes:
        kind: background, layer, truth, an annotation, prediction or evaluation.
        name: function and sensor of a prediction or evaluation.
        digest: digest of the product.
        verdict: ``equal``, ``differs``, ``not stored`` or the reason why it could not be made here.
        cpu_seconds: its CPU time.
        details: for an evaluation, name to the stored and the new value of each score that differs.
    """

    kind: str
    name: str
    digest: str
    verdict: str
    cpu_seconds: float = 0.0
    details: Mapping[str, tuple[Cell, Cell]] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """True if the product equals the stored one."""
        return self.verdict == "equal"


def replay_frame(context: Context, key: FrameKey) -> list[Replayed]:
    """Render and infer one frame again; the store is only read for the comparison.

    Raises:
        NotFound: no such run or frame.
    """
    with reading_run(context.engine, key.run_id) as connection:
        run = runs.get(connection, key.run_id)
        frame = frames.get(connection, key)
        annotations = frames.annotation_links(connection, key)
        evaluations = results.frame_evaluations(connection, key)
    replay = _Replay(context)
    scratch = replay.scratch
    render, infer, evaluate = RenderMaker(scratch), InferMaker(scratch), EvaluateMaker(scratch)
    kinds = (ProductKind.BACKGROUND, ProductKind.LAYER, ProductKind.TRUTH)
    products = zip(kinds, frame.products.required, strict=True)
    replayed = [replay.compare(render, Job(digest, kind, 1, frame)) for kind, digest in products]
    replayed += [
        replay.compare(render, Job(link.product, ProductKind(kind), 1, frame), stored=link)
        for kind, link in annotations.items()
    ]
    for row in evaluations:
        look = EvaluationLink.of(row)
        name = f"{run.spec.functions[look.function]} / {run.spec.sensors[look.sensor].name}"
        replayed.append(replay.compare(infer, Job(row.prediction, ProductKind.PREDICTION, 1, frame, look), name))
        if row.empty is not None:
            empty = Job(row.empty, ProductKind.PREDICTION, 1, frame, look)
            replayed.append(replay.compare(infer, empty, f"{name}, without movables"))
        replayed.append(
            replay.compare(evaluate, Job(row.scores, ProductKind.EVALUATION, 1, frame, look), name, stored=row)
        )
    return replayed


class _Replay:
    """Comparison of products, made into a store in memory, with those of the real one."""

    def __init__(self, context: Context) -> None:
        self._real = context.store
        self.scratch = replace(context, store=ArtifactStore(MemoryStore(), url="memory:"))

    def compare(
        self, maker: Maker, job: Job, name: str = "", *, stored: AnnotationLink | FrameEvaluation | None = None
    ) -> Replayed:
        """Make a product and compare it with the stored one.

        Args:
            maker: maker of the product.
            job: job of the product.
            name: function and sensor.
            stored: link of an annotation, or an evaluation, whose results are rows instead of objects.
        """
        started = time.process_time()
        try:
            finished = maker.make(job)
        except ValerieError as error:
            return Replayed(job.kind, name, job.digest, f"cannot be made here: {error}")
        seconds = time.process_time() - started
        differing: dict[str, tuple[Cell, Cell]] = {}
        if isinstance(stored, FrameEvaluation):
            differing = _differing(finished.score, stored.score)
            same = None if stored.score is None else not differing
        elif job.kind is ProductKind.LIGHT and stored is not None:
            done = stored.state is ProductState.DONE
            same = self._same_light(job.frame.key.run_id, finished) if done else None
        else:
            same = self._same_object(job)
        verdict = "not stored" if same is None else "equal" if same else "differs"
        return Replayed(job.kind, name, job.digest, verdict, seconds, differing)

    def _same_object(self, job: Job) -> bool | None:
        """Return True if the stored object equals the new one; None if there is none."""
        key = product_key(job.kind, job.digest)
        try:
            same = self._real.get(key) == self.scratch.store.get(key)
        except NotFound:
            return None
        return same or (job.kind is ProductKind.TRUTH and self._same_truth(job.digest))

    def _same_light(self, run_id: str, finished: Finished) -> bool:
        with reading_run(self.scratch.engine, run_id) as connection:
            return measured.person_lights(connection, finished.digest) == list(finished.person_lights)

    def _same_truth(self, digest: str) -> bool:
        """Return True if two truths have equal contents; one may be stored whole and the other over its statics."""
        try:
            fresh = ProductReader(self.scratch.store).truth(digest)
            stored = ProductReader(self._real).truth(digest)
        except MissingInput:
            return False
        return codecs.encode_truth(fresh) == codecs.encode_truth(stored)


def _differing(new: FrameScore | None, stored: FrameScore | None) -> dict[str, tuple[Cell, Cell]]:
    """Return name to the stored and the new value of each score that differs; empty if none are stored."""
    if new is None or stored is None:
        return {}
    return {name: (stored.figures[name], value) for name, value in new.figures.items() if stored.figures[name] != value}
