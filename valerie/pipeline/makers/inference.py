"""Makes predictions: frame → sensor stage → picture → function under test."""

from __future__ import annotations

import time

from valerie import plugins
from valerie.db.products import Finished, Job
from valerie.errors import InferenceError, TransientError
from valerie.perception.base import PerceptionFunction
from valerie.pipeline.capture import capture_of
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inputs import ProductReader
from valerie.pipeline.makers.resolved import RunCache
from valerie.storage import codecs
from valerie.storage.keys import product_key


class InferMaker:
    """One network stays loaded; messages hold products of one function, so it seldom changes."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._runs = RunCache(context)
        self._reader = ProductReader(context.store)
        self._threads = context.settings.inference_threads
        self._loaded: tuple[str, PerceptionFunction] | None = None

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.stages.Maker`."""
        started = time.process_time()
        run = self._runs.run(job.run_id)
        spec = run.resolved.spec
        if job.sensor_index is None or job.function_index is None:
            raise InferenceError(f"product {job.digest} is no prediction")
        name = spec.functions[job.function_index]
        pin = run.pins["functions"][name]
        function = self._function(name, pin["digest"])
        if function.numeric_class != pin["numeric_class"]:
            raise TransientError(f"{name} runs as {function.numeric_class} here; the run pinned {pin['numeric_class']}")
        capture = capture_of(
            run.resolved,
            sensor_index=job.sensor_index,
            camera_index=job.camera_index,
            assignment=job.assignment,
            background=job.background,
            layer=job.layer,
            truth=job.truth,
        )
        picture = capture.picture(self._reader)
        prediction = function.predict(picture)
        if prediction.shape != picture.shape[:2]:
            raise InferenceError(f"{name} answered {prediction.shape} for a picture of {picture.shape[:2]}")
        data = codecs.encode_prediction(prediction)
        self._context.store.put(product_key("prediction", job.digest), data)
        return Finished(job.digest, len(data), int(prediction.size), time.process_time() - started)

    def _function(self, name: str, digest: str) -> PerceptionFunction:
        if self._loaded is None or self._loaded[0] != name:
            if self._loaded is not None:
                self._loaded[1].close()
            self._loaded = (name, plugins.create_function(name, threads=self._threads))
        function = self._loaded[1]
        if function.card.digest != digest:
            raise TransientError(f"{name} has digest {function.card.digest[:12]} here; the run pinned {digest[:12]}")
        return function
