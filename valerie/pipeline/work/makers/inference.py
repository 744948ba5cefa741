"""Predictions: frame → sensor stage → picture → function under test."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final, NamedTuple

import psutil
from numpy import uint8
from numpy.typing import NDArray

from valerie.db.claiming import EvaluationLink, Job
from valerie.db.publishing import Finished
from valerie.errors import InferenceError, ValerieError
from valerie.measures import Measures
from valerie.perception.running.batches import require_size
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.functions.bounded import BoundedFunction, open_bounded
from valerie.pipeline.functions.loader import FunctionLoader
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.runs.products.pins import FunctionPin
from valerie.sensing.picture_levels import picture_levels
from valerie.storage import codecs
from valerie.storage.keys import product_key

#: Most functions that stay open.
_MOST_OPEN: Final = 4


class Predicted(NamedTuple):
    """A prediction, the grey levels of its picture, and its CPU seconds."""

    labels: NDArray[uint8]
    levels: Measures
    cpu_seconds: float


class InferMaker:
    """Maker of predictions. The last functions stay open, since the messages of a run alternate between its functions.

    If the function takes several pictures at once, the pictures of the next products are predicted together with the current
    one, and kept until their turn. Claims, storing and failures remain separate for each product.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._reader = ProductReader(context.store)
        self._source = FunctionLoader(context)
        self._settings = context.settings
        self._tell: Callable[[str], None] | None = None
        self._open: dict[tuple[str, ...], BoundedFunction] = {}
        self._expected: dict[str, Job] = {}
        self._ahead: dict[str, Predicted] = {}

    def expect(self, jobs: Sequence[Job]) -> None:
        """See `valerie.pipeline.work.stages.LooksAhead`."""
        self._expected = {job.digest: job for job in jobs}
        self._ahead.clear()

    def before_end(self, tell: Callable[[str], None]) -> None:
        """See `valerie.pipeline.work.stages.MayEnd`."""
        self._tell = tell

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        self._expected.pop(job.digest, None)
        predicted = self._ahead.pop(job.digest) if job.digest in self._ahead else self._predict(job)
        started = time.process_time()
        data = codecs.encode_prediction(predicted.labels)
        self._context.store.put(product_key("prediction", job.digest), data)
        return Finished(
            digest=job.digest,
            bytes=len(data),
            pixels=int(predicted.labels.size),
            cpu_seconds=predicted.cpu_seconds + time.process_time() - started,
            picture=predicted.levels,
        )

    def _predict(self, job: Job) -> Predicted:
        """Predict one picture together with some of the next ones."""
        started = time.process_time()
        run, look = started_run(self._context, job.frame.key.run_id), _look(job)
        name = run.resolved.spec.functions[look.function]
        function = self._function(name, run.pins.at(job.frame.assignment).functions[name])
        pictures = {job.digest: self._picture(job)}
        # A second attempt has no companions: a picture that ended a process must not harm its neighbours twice.
        size = function.batch_size if job.attempts == 1 else 1
        if size > 1:
            pictures |= self._companions(job, pictures[job.digest].shape, size - 1)
        predictions = self._predictions(function, list(pictures.values()))
        levels = [picture_levels(picture) for picture in list(pictures.values())[: len(predictions)]]
        each = (time.process_time() - started) / len(predictions)
        predicted = {
            digest: Predicted(labels, grey, each)
            for digest, labels, grey in zip(pictures, predictions, levels, strict=False)
        }
        self._ahead |= predicted
        return self._ahead.pop(job.digest)

    def _predictions(self, function: BoundedFunction, pictures: Sequence[NDArray[uint8]]) -> Sequence[NDArray[uint8]]:
        """Predict all pictures, or only the first if they fail together, so that no picture harms another."""
        predictions = None
        if len(pictures) > 1:
            with suppress(Exception):  # a plug-in may raise anything, and each picture must fail alone
                predictions = function.predict_many(pictures)
        if predictions is None:
            predictions = [function.predict(pictures[0])]
        for prediction in predictions:
            require_size(function.card.name, prediction, pictures[0])
        return predictions

    def _companions(self, job: Job, shape: tuple[int, ...], most: int) -> dict[str, NDArray[uint8]]:
        """Return the next pictures of the same size for the same function of the same run."""
        companions: dict[str, NDArray[uint8]] = {}
        for other in self._expected.values():
            if len(companions) == most:
                break
            same = (other.frame.key.run_id, _look(other).function) == (job.frame.key.run_id, _look(job).function)
            if not same or other.attempts > 1 or other.digest in self._ahead:
                continue
            try:
                picture = self._picture(other)
            except ValerieError:
                continue  # reported in its turn
            if picture.shape == shape:
                companions[other.digest] = picture
        return companions

    def _picture(self, job: Job) -> NDArray[uint8]:
        """Return the picture that the function sees."""
        resolved = started_run(self._context, job.frame.key.run_id).resolved
        look = _look(job)
        capture = capture_of(resolved, job.frame, look.sensor)
        return capture.empty_picture(self._reader) if job.digest == look.empty else capture.picture(self._reader)

    def _function(self, name: str, pin: FunctionPin) -> BoundedFunction:
        key = (name, pin.digest, pin.numeric_class)
        if key not in self._open:
            self._make_room()
            self._open[key] = open_bounded(
                lambda: self._source.open(name, pin), self._settings, name=name, before_end=self._say
            )
        return self._open[key]

    def _make_room(self) -> None:
        """Close all functions if there are many, or if they use half of a worker's memory limit."""
        half = self._settings.worker_max_memory_mb << 19
        if len(self._open) >= _MOST_OPEN or psutil.Process().memory_info().rss > half:
            while self._open:
                self._open.popitem()[1].close()  # the newest first, since each restores the previous limit

    def _say(self, reason: str) -> None:
        if self._tell is not None:
            self._tell(f"{reason} (VALERIE_INFER_SECONDS)")


def _look(job: Job) -> EvaluationLink:
    if job.look is None:
        raise InferenceError(f"product {job.digest} is not a prediction")
    return job.look
