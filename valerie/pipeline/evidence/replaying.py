"""Replay frames of an evidence folder, only from its spec and pins, and compare the pixels."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import SystemRandom
from tempfile import TemporaryDirectory
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import TypeAdapter, ValidationError

from valerie.db import runs
from valerie.db.claiming import EvaluationLink, Job
from valerie.db.engine import writing
from valerie.db.links import StoredFrame
from valerie.db.migrate import migrate
from valerie.db.runs import SubmittedRun
from valerie.errors import ValerieError
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.base.resolved_runs import StoredRun, read_run, resolve_new
from valerie.pipeline.evidence.contents import FRAMES, PINS, RUN, SPEC, FrameEntry, FrameList, RunFacts
from valerie.pipeline.evidence.evidence_manifest import MAX_BYTES, Refused, read_document
from valerie.pipeline.reading.capture import capture_of
from valerie.pipeline.reading.painting import FramePainter
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.work.makers.inference import InferMaker
from valerie.pipeline.work.makers.rendering import RenderMaker
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.inputs import FrameDigests, ProductInputs
from valerie.runs.products.pictures import PictureKind
from valerie.runs.products.pins import ANY_PINS
from valerie.runs.products.states import Priority, ProductKind, RunState
from valerie.runs.resolving.spec import parse
from valerie.settings import Settings

EQUAL: Final = "equal"
DIFFERS: Final = "differs"
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReplayedPicture:
    """A replayed picture of the folder.

    Attributes:
        file: its path; empty if no picture could be made.
        verdict: ``equal``, ``differs``, or the reason why it cannot be made here.
    """

    file: str
    verdict: str


def replay(folder: Path, count: int, settings: Settings) -> list[ReplayedPicture]:
    """Replay randomly chosen frames of a verified folder and compare their pictures.

    It needs the run's asset, engine and functions in the numeric classes that the run pinned. Functions that were
    registered, and uploaded predictions, are not in the folder.

    Args:
        folder: folder that `valerie.pipeline.evidence.verifying.verify` accepted.
        count: number of frames; all if there are fewer.
        settings: settings of this machine: assets, engines, bounds of functions.

    Raises:
        Refused: a document of the folder is not valid.
    """
    entries = _document(folder, FRAMES, TypeAdapter(FrameList)).frames
    sample = [entries[i] for i in sorted(SystemRandom().sample(range(len(entries)), min(count, len(entries))))]
    if not sample:
        return []
    try:
        with _deployment(folder, settings) as (context, run):
            frames = _Frames(context, run)
            return [picture for entry in sample for picture in frames.compare(folder, entry)]
    except Refused:
        raise
    except ValerieError as error:
        return [ReplayedPicture("", f"cannot be made here: {error}")]


@contextmanager
def _deployment(folder: Path, settings: Settings) -> Iterator[tuple[Context, StoredRun]]:
    """Open a deployment in a temporary folder that contains only the run.

    Raises:
        ValerieError: the run's asset, engine or functions are missing here, or the asset changed.
    """
    facts, pins = _document(folder, RUN, TypeAdapter(RunFacts)), _document(folder, PINS, ANY_PINS)
    spec = parse(read_document(folder, SPEC))
    if spec.digest != facts.spec_digest:
        raise Refused([f"{RUN}: its digest of the spec is not that of {SPEC}"])
    resolved = resolve_new(
        spec, settings, registered=[name for name, pin in pins.functions.items() if pin.kind is not None]
    )
    with TemporaryDirectory(prefix="valerie-evidence-") as place:
        update = {"data_dir": Path(place), "database_url": f"sqlite:///{place}/run.sqlite3", "artifacts_url": place}
        context = open_context(settings.model_copy(update=update))
        try:
            migrate(context.engine)
            row = SubmittedRun(
                id=facts.id,
                name=facts.name,
                state=RunState.COMPLETED,
                reason=None,
                spec=spec,
                spec_digest=facts.spec_digest,
                asset_digest=facts.asset_digest,
                pins=pins,
                parent_run=None,
                iteration=facts.iteration,
                variant_count=resolved.space.size,
                priority=Priority.NORMAL,
                deadline=None,
                owner=None,
                project="",
                tenant="",
                forecast=None,
                created_at=facts.created_at,
            )
            with writing(context.engine) as connection:
                runs.create(connection, row)
            yield context, read_run(context, facts.id)
        finally:
            context.engine.dispose()


class _Frames:
    """Makes frames of one run into the store of a deployment."""

    def __init__(self, context: Context, run: StoredRun) -> None:
        self._run, self._reader = run, ProductReader(context.store)
        self._render, self._infer = RenderMaker(context), InferMaker(context)

    def compare(self, folder: Path, entry: FrameEntry) -> Iterator[ReplayedPicture]:
        """Yield the pictures of a frame: rendered ones first."""
        frame, digests = self._frame(entry)
        looks = {
            e.function_index: EvaluationLink(e.sensor_index, e.function_index, e.prediction)
            for e in digests.evaluations
            if e.sensor_index == entry.sensor
        }
        try:
            self._make_frame(frame, digests)
        except ValerieError as error:
            yield from (ReplayedPicture(file, f"cannot be made here: {error}") for _, _, _, file in entry.pictures)
            return
        capture = capture_of(self._run.resolved, frame, entry.sensor)
        painter = FramePainter(self._reader)
        for kind, function, person, file in entry.pictures:
            try:
                prediction = None
                if function is not None:
                    look = looks[function]
                    self._infer.make(Job(look.prediction, ProductKind.PREDICTION, 1, frame, look))
                    prediction = look.prediction
                pixels = (
                    painter.paint(PictureKind(kind), capture=capture, prediction=prediction)
                    if person is None or prediction is None
                    else painter.close_up(capture=capture, prediction=prediction, person=person)
                )
            except ValerieError as error:
                yield ReplayedPicture(file, f"cannot be made here: {error}")
                continue
            yield ReplayedPicture(file, EQUAL if _shows(folder, file, pixels) else DIFFERS)

    def _frame(self, entry: FrameEntry) -> tuple[StoredFrame, FrameDigests]:
        resolved = self._run.resolved
        known = (
            entry.variant < resolved.space.size
            and entry.camera < len(resolved.cameras)
            and entry.time < len(resolved.times.elapsed)
            and entry.sensor < len(resolved.spec.sensors)
            and all(0 <= function < len(resolved.spec.functions) for function in entry.functions)
        )
        if not known:
            raise Refused([f"{FRAMES}: {entry.place} is not a frame of the spec"])
        ((_, assignment),) = resolved.space.values(entry.variant, entry.variant + 1)
        inputs = ProductInputs(resolved, asset_digest=resolved.asset_digest, pins=self._run.pins.at(assignment))
        digests = inputs.frame(
            resolved.at(assignment, entry.time), entry.camera, course=resolved.around(assignment, entry.time)
        )
        key = FrameKey(self._run.id, entry.variant, entry.camera, entry.time)
        return StoredFrame(key, digests.products, dict(assignment)), digests

    def _make_frame(self, frame: StoredFrame, digests: FrameDigests) -> None:
        kinds = (ProductKind.BACKGROUND, ProductKind.LAYER, ProductKind.TRUTH)
        for kind, digest in zip(kinds, frame.products.required, strict=True):
            self._render.make(Job(digest, kind, 1, frame))
        for kind, digest, _ in digests.annotations:
            if kind is ProductKind.VELOCITY:
                self._render.make(Job(digest, kind, 1, frame))


def _shows(folder: Path, file: str, pixels: NDArray[np.uint8]) -> bool:
    """Return True if a PNG file contains exactly these pixels, (H, W, 3)."""
    data = read_document(folder, file, max_bytes=MAX_BYTES)
    try:
        with Image.open(io.BytesIO(data), formats=("PNG",)) as image:
            height, width = pixels.shape[:2]
            return image.size == (width, height) and np.array_equal(np.asarray(image), pixels)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise Refused([f"{file}: not a PNG picture ({error})"]) from None


def _document(folder: Path, name: str, form: TypeAdapter[T]) -> T:
    try:
        return form.validate_json(read_document(folder, name))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise Refused([f"{name}: {'.'.join(map(str, first['loc']))}: {first['msg']}"]) from None
