"""Making one frame again in this process and comparing it with what is stored, byte for byte."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from valerie.db import results, runs
from valerie.db.engine import reading
from valerie.db.products import Finished, Job
from valerie.errors import MissingInput, NotFound, ValerieError
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.work.makers.evaluation import EvaluateMaker
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
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


def replay_frame(context: Context, run_id: str, variant: int, camera: int, time_index: int = 0) -> list[Replayed]:
    """Render and infer one frame again, with nothing taken from the store but what it is compared with.

    Raises:
        NotFound: no such run or frame.
    """
    with reading(context.engine) as connection:
        run = runs.get(connection, run_id)
        frame = results.frame(connection, run_id, variant, camera, time_index)
        annotations = results.frame_annotations(connection, run_id, variant, camera, time_index)
        evaluations = results.frame_evaluations(connection, run_id, variant, camera, time_index)
    scratch = _Scratch(context)
    shared: dict[str, Any] = {
        "attempts": 1,
        "run_id": run_id,
        "variant_index": variant,
        "assignment": frame.assignment,
        "camera_index": camera,
        "time_index": time_index,
        "background": frame.background,
        "layer": frame.layer,
        "truth": frame.truth,
        "velocity": annotations["velocity"].product if "velocity" in annotations else None,
    }
    render, infer, evaluate = RenderMaker(scratch.context), InferMaker(scratch.context), EvaluateMaker(scratch.context)
    made = [
        scratch.compare(render, Job(digest=digest, kind=kind, **shared), "")
        for kind, digest in (
            (ProductKind.BACKGROUND, frame.background),
            (ProductKind.LAYER, frame.layer),
            (ProductKind.TRUTH, frame.truth),
        )
    ]
    made += [
        scratch.compare(render, Job(one.product, ProductKind(kind), **shared), "", stored=one)
        for kind, one in annotations.items()
    ]
    spec = run.spec
    for one in evaluations:
        name = f"{spec.functions[one.function_index]} / {spec.sensors[one.sensor_index].name}"
        links = {
            **shared,
            "prediction": one.prediction,
            "sensor_index": one.sensor_index,
            "function_index": one.function_index,
        }
        made.append(scratch.compare(infer, Job(digest=one.prediction, kind=ProductKind.PREDICTION, **links), name))
        made.append(
            scratch.compare(evaluate, Job(digest=one.scores, kind=ProductKind.EVALUATION, **links), name, stored=one)
        )
    return made


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

    def compare(self, maker: Any, job: Job, name: str, *, stored: Any = None) -> Replayed:
        """Make a product and compare it with the stored one."""
        started = time.process_time()
        try:
            finished: Finished = maker.make(job)
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
