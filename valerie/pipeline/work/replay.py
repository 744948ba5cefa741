"""Making one frame again in this process and comparing it with what is stored, byte for byte."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from obstore.store import MemoryStore

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.db.products import Finished, Job, Look
from valerie.errors import MissingInput, NotFound, ValerieError
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.pipeline.work.stages import Maker
from valerie.runs.frames import FrameKey
from valerie.runs.states import ProductKind
from valerie.storage import codecs
from valerie.storage.keys import product_key
from valerie.storage.store import ArtifactStore


@dataclass(frozen=True, slots=True)
class Replayed:
    """One product of the frame, made again.

    Attributes:
        kind: background, layer, truth, an annotation, prediction or evaluation.
        name: which function and sensor, for predictions and evaluations.
        digest: of the product.
        verdict: ``equal``, ``differs``, ``not stored`` or why it could not be made here.
        cpu_seconds: that making it cost.
        details: of an evaluation, name to the stored and the new value of each score that differs.
    """

    kind: str
    name: str
    digest: str
    verdict: str
    cpu_seconds: float = 0.0
    details: Mapping[str, tuple[object, object]] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """True where the product is the stored one."""
        return self.verdict == "equal"


def replay_frame(context: Context, key: FrameKey) -> list[Replayed]:
    """Render and infer one frame again, with nothing taken from the store but what it is compared with.

    Raises:
        NotFound: no such run or frame.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, key.run_id)
        frame = results.frame(connection, key)
        annotations = results.frame_annotations(connection, key)
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
        look = Look(row.sensor_index, row.function_index, row.prediction)
        name = f"{run.spec.functions[look.function]} / {run.spec.sensors[look.sensor].name}"
        replayed.append(replay.compare(infer, Job(row.prediction, ProductKind.PREDICTION, 1, frame, look), name))
        replayed.append(
            replay.compare(evaluate, Job(row.scores, ProductKind.EVALUATION, 1, frame, look), name, stored=row)
        )
    return replayed


class _Replay:
    """Makes products into a store in memory and compares them with those of the real one."""

    def __init__(self, context: Context) -> None:
        self._real = context.store
        self.scratch = replace(context, store=ArtifactStore(MemoryStore(), url="memory:"))

    def compare(self, maker: Maker, job: Job, name: str = "", *, stored: Any = None) -> Replayed:
        """Make a product and compare it with the stored one."""
        started = time.process_time()
        try:
            finished = maker.make(job)
        except ValerieError as error:
            return Replayed(job.kind, name, job.digest, f"cannot be made here: {error}")
        seconds = time.process_time() - started
        if job.kind == "evaluation":
            differing = _differing(finished, stored)
            verdict = "not stored" if stored.scores_state != "done" else "differs" if differing else "equal"
            return Replayed(job.kind, name, job.digest, verdict, seconds, differing)
        if job.kind == "light":
            verdict = "not stored" if stored.state != "done" else "equal" if self._same_light(finished) else "differs"
        else:
            verdict = self._verdict(job)
        return Replayed(job.kind, name, job.digest, verdict, seconds)

    def _verdict(self, job: Job) -> str:
        key = product_key(job.kind, job.digest)
        try:
            same = self._real.get(key) == self.scratch.store.get(key)
        except NotFound:
            return "not stored"
        return "equal" if same or (job.kind == "truth" and self._same_truth(job.digest)) else "differs"

    def _same_light(self, finished: Finished) -> bool:
        with reading(self.scratch.engine) as connection:
            rows = results.person_lights(connection, finished.digest)
        return [dict(row._mapping) for row in rows] == list(finished.person_lights)  # noqa: SLF001  # public

    def _same_truth(self, digest: str) -> bool:
        """Return whether two truths hold the same, one perhaps whole and the other over its statics."""
        try:
            fresh = ProductReader(self.scratch.store).truth(digest)
            stored = ProductReader(self._real).truth(digest)
        except MissingInput:
            return False
        return codecs.encode_truth(fresh) == codecs.encode_truth(stored)


def _differing(finished: Finished, stored: Any) -> dict[str, tuple[object, object]]:
    """Return name to the stored and the new value of each score that differs; nothing where none are stored."""
    scores = finished.score or {}
    if stored.scores_state != "done":
        return {}
    names = (name for name in scores if name not in ("digest", "confusion"))
    return {name: (getattr(stored, name), scores[name]) for name in names if getattr(stored, name) != scores[name]}
