"""Making one frame again in this process and comparing it with what is stored, byte for byte."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.db.products import Job, Look
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
from valerie.storage.store import ObjectInfo


@dataclass(frozen=True, slots=True)
class Replayed:
    """One product of the frame, made again.

    Attributes:
        kind: background, layer, truth, an annotation, prediction or evaluation.
        name: which function and sensor, for predictions and evaluations.
        verdict: ``equal``, ``differs``, ``not stored`` or why it could not be made here.
    """

    kind: str
    name: str
    digest: str
    verdict: str
    cpu_seconds: float = 0.0
    details: dict[str, Any] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
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
    scratch = _Scratch(context)
    render, infer, evaluate = RenderMaker(scratch.context), InferMaker(scratch.context), EvaluateMaker(scratch.context)
    products = {
        ProductKind.BACKGROUND: frame.products.background,
        ProductKind.LAYER: frame.products.layer,
        ProductKind.TRUTH: frame.products.truth,
    }
    replayed = [scratch.compare(render, Job(digest, kind, 1, frame)) for kind, digest in products.items()]
    replayed += [
        scratch.compare(render, Job(link.product, ProductKind(kind), 1, frame), stored=link)
        for kind, link in annotations.items()
    ]
    for row in evaluations:
        look = Look(row.sensor_index, row.function_index, row.prediction)
        name = f"{run.spec.functions[look.function]} / {run.spec.sensors[look.sensor].name}"
        replayed.append(scratch.compare(infer, Job(row.prediction, ProductKind.PREDICTION, 1, frame, look), name))
        replayed.append(
            scratch.compare(evaluate, Job(row.scores, ProductKind.EVALUATION, 1, frame, look), name, stored=row)
        )
    return replayed


class _Scratch:
    """A context whose store is a dictionary, so that nothing of the real store is read or written by the makers."""

    def __init__(self, context: Context) -> None:
        self._real = context.store
        self._objects: dict[str, bytes] = {}
        self.context = Context(
            settings=context.settings,
            engine=context.engine,
            store=self,  # type: ignore[arg-type]  # the methods that makers use
            broker=context.broker,
            owner=context.owner,
        )

    def put(self, key: str, data: bytes) -> bool:
        """As `ArtifactStore.put`."""
        self._objects[key] = data
        return True

    def get(self, key: str) -> bytes:
        """As `ArtifactStore.get`."""
        try:
            return self._objects[key]
        except KeyError:
            raise NotFound("object", key) from None

    def head(self, key: str) -> ObjectInfo:
        """As `ArtifactStore.head`."""
        return ObjectInfo(key, len(self.get(key)), "", datetime.now(UTC))

    def exists(self, key: str) -> bool:
        """As `ArtifactStore.exists`."""
        return key in self._objects

    def compare(self, maker: Maker, job: Job, name: str = "", *, stored: Any = None) -> Replayed:
        """Make a product and compare it with the stored one."""
        started = time.process_time()
        try:
            finished = maker.make(job)
        except ValerieError as error:
            return Replayed(job.kind, name, job.digest, f"cannot be made here: {error}")
        seconds = time.process_time() - started
        if job.kind == "light":
            with reading(self.context.engine) as connection:
                known_rows = [dict(row._mapping) for row in results.person_lights(connection, job.digest)]  # noqa: SLF001
            verdict = "not stored" if stored.state != "done" else "differs"
            return Replayed(
                job.kind, name, job.digest, "equal" if known_rows == list(finished.person_lights) else verdict, seconds
            )
        if job.kind == "evaluation":
            fresh = finished.score or {}
            names = [name for name in fresh if name not in ("digest", "confusion")]
            known = stored.scores_state == "done"
            differing = {n: (getattr(stored, n), fresh[n]) for n in names if known and getattr(stored, n) != fresh[n]}
            verdict = "not stored" if not known else "differs" if differing else "equal"
            return Replayed(job.kind, name, job.digest, verdict, seconds, differing)
        key = product_key(job.kind, job.digest)
        try:
            same = self._real.get(key) == self._objects[key] or (job.kind == "truth" and self._same_truth(job.digest))
            verdict = "equal" if same else "differs"
        except NotFound:
            verdict = "not stored"
        return Replayed(job.kind, name, job.digest, verdict, seconds)

    def _same_truth(self, digest: str) -> bool:
        """Whether two truths hold the same, one perhaps whole and the other over its statics."""
        try:
            fresh, stored = ProductReader(self.context.store).truth(digest), ProductReader(self._real).truth(digest)
        except MissingInput:
            return False
        return codecs.encode_truth(fresh) == codecs.encode_truth(stored)
