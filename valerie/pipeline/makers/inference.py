"""Makes predictions: frame → sensor stage → picture → function under test."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from valerie.db.products import Finished, Job
from valerie.errors import InferenceError
from valerie.perception.base import PerceptionFunction
from valerie.perception.limits import time_limit
from valerie.pipeline.capture import capture_of
from valerie.pipeline.context import Context
from valerie.pipeline.function_source import FunctionSource
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
        self._source = FunctionSource(context)
        self._seconds = context.settings.infer_seconds
        self._loaded: tuple[tuple[str, ...], PerceptionFunction] | None = None

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.stages.Maker`."""
        started = time.process_time()
        run = self._runs.run(job.run_id)
        spec = run.resolved.spec
        if job.sensor_index is None or job.function_index is None:
            raise InferenceError(f"product {job.digest} is no prediction")
        name = spec.functions[job.function_index]
        pin = run.pins["functions"][name]
        with time_limit(self._seconds, what=f"opening {name}"):
            function = self._function(name, pin)
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
        with time_limit(self._seconds, what=name):
            prediction = function.predict(picture)
        if prediction.shape != picture.shape[:2]:
            raise InferenceError(f"{name} answered {prediction.shape} for a picture of {picture.shape[:2]}")
        data = codecs.encode_prediction(prediction)
        self._context.store.put(product_key("prediction", job.digest), data)
        return Finished(job.digest, len(data), int(prediction.size), time.process_time() - started)

    def _function(self, name: str, pin: Mapping[str, Any]) -> PerceptionFunction:
        key = (name, pin["digest"], pin["numeric_class"])
        if self._loaded is None or self._loaded[0] != key:
            if self._loaded is not None:
                self._loaded[1].close()
                self._loaded = None  # one network at a time, also while the next one is opened
            self._loaded = (key, self._source.open(name, pin))
        return self._loaded[1]
