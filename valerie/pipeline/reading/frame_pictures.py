"""The pictures of one frame: sources and painting."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.db import frames, results
from valerie.db.archives import reading_run
from valerie.db.frames import AnnotationLink
from valerie.db.links import StoredFrame
from valerie.db.results import PredictionLink
from valerie.errors import Conflict, NotFound, UnknownName
from valerie.labels import to_label_ids
from valerie.parameters.assignment import digest
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import started_run
from valerie.pipeline.reading.capture import Capture, capture_of
from valerie.pipeline.reading.painting import PAINTING_REVISION, FramePainter
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.selection import function_index, sensor_index
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.pictures import ANNOTATION_KINDS, FRAME_KINDS, FUNCTION_KINDS, PictureKind
from valerie.runs.products.states import ProductState
from valerie.runs.resolving.spec import ResolvedRun

#: Kinds that show only the ground truth, and only the picture (with or without a prediction).
_OF_TRUTH: Final = (PictureKind.TRUTH, PictureKind.INSTANCES, PictureKind.DEPTH)
_OF_IMAGE: Final = (PictureKind.PICTURE, PictureKind.OVERLAY, PictureKind.BOXES, PictureKind.JOINTS)


@dataclass(frozen=True, slots=True)
class ShownProducts:
    """The stored products that one picture shows.

    Attributes:
        kind: what it shows.
        capture: the frame and its sensor.
        prediction: digest of the prediction; None without one.
        annotation: digest of the annotation, for a kind that shows one.
    """

    kind: PictureKind
    capture: Capture
    prediction: str | None
    annotation: str | None = None

    @property
    def tag(self) -> str:
        """Digest of the picture, 32 hexadecimal characters, known before it is painted."""
        product = self.prediction or self.annotation or ""
        return digest("picture", PAINTING_REVISION, self.kind, self.capture.tag, product)


@dataclass(frozen=True, slots=True)
class FrameSources:
    """The rows of one frame that its pictures may show.

    Attributes:
        resolved: its run.
        frame: the frame.
        states: state of each product, by digest.
        annotations: kind to product.
        predictions: of the frame; empty unless asked for.
    """

    resolved: ResolvedRun
    frame: StoredFrame
    states: Mapping[str, ProductState]
    annotations: Mapping[str, AnnotationLink]
    predictions: Sequence[PredictionLink]

    def picture(self, kind: PictureKind, *, function: str | None = None, sensor: str | None = None) -> ShownProducts:
        """Find the products that a picture shows; see `find_picture`."""
        place = (sensor_index(sensor, self.resolved), function_index(function, self.resolved))
        link = next((link for link in self.predictions if (link.sensor_index, link.function_index) == place), None)
        capture = capture_of(self.resolved, self.frame, place[0])
        needed = [self.states[product] for product in _needed(kind, capture)]
        if kind in FUNCTION_KINDS and link is not None:
            needed.append(link.state)
        annotation = None
        if kind in ANNOTATION_KINDS:
            if kind not in self.annotations:
                known = (
                    *FRAME_KINDS,
                    *FUNCTION_KINDS,
                    *(name for name in self.annotations if name in ANNOTATION_KINDS),
                )
                raise UnknownName("kind of picture", kind, known, field="kind")
            annotation = self.annotations[kind].product
            needed.append(self.annotations[kind].state)
        missing = [state for state in needed if state != ProductState.DONE]
        if missing and self.frame.removed is not None:
            raise Conflict(
                f"the picture was removed when its run completed ({self.frame.removed}); the thumbnail remains "
                "(GET /v1/explore/sheet), and a run of the same spec with retention: all makes the picture again"
            )
        if missing:
            raise Conflict(f"the picture is not available yet: a product that it needs is {missing[0]}")
        return ShownProducts(kind, capture, None if link is None else link.prediction, annotation)


def frame_sources(context: Context, key: FrameKey, *, evaluated: bool) -> FrameSources:
    """Read the products that the pictures of a frame may show.

    Args:
        context: of this process.
        key: the frame.
        evaluated: True reads its predictions too.

    Raises:
        NotFound: no such run or frame.
    """
    found = sources_of_frames(context, key.run_id, [key], evaluated=evaluated)
    if key not in found:
        raise NotFound("frame", key)
    return found[key]


def sources_of_frames(
    context: Context, run_id: str, keys: Collection[FrameKey], *, evaluated: bool
) -> dict[FrameKey, FrameSources]:
    """Read the products that the pictures of several frames of a run may show; unknown frames are left out.

    Raises:
        NotFound: no such run.
    """
    resolved = started_run(context, run_id).resolved
    with reading_run(context.engine, run_id) as connection:
        found = frames.several(connection, keys)
        annotations = {key: frames.annotation_links(connection, key) if resolved.annotations else {} for key in found}
        predictions = results.prediction_links(connection, found) if evaluated else {}
        required = {digest for frame in found.values() for digest in frame.products.required}
        states = results.product_states(connection, required)
    states |= {link.product: link.state for links in annotations.values() for link in links.values()}
    return {
        key: FrameSources(resolved, frame, states, annotations[key], predictions.get(key, ()))
        for key, frame in found.items()
    }


def find_picture(
    context: Context, key: FrameKey, *, kind: str, function: str | None = None, sensor: str | None = None
) -> ShownProducts:
    """Find the products that a picture shows.

    Args:
        context: context of this process.
        key: the frame.
        kind: a `PictureKind`, or its name.
        function, sensor: names in the spec; None: the first.

    Raises:
        NotFound: no such run or frame.
        UnknownName: no such kind, function, sensor setting or annotation.
        Conflict: a product that the picture needs is not available yet.
    """
    kind = PictureKind.parse(kind)
    sources = frame_sources(context, key, evaluated=kind in FUNCTION_KINDS)
    return sources.picture(kind, function=function, sensor=sensor)


def paint_picture(context: Context, source: ShownProducts, *, person: int | None = None) -> NDArray[np.uint8]:
    """Paint a picture, or a person of its frame from near (`FramePainter.close_up`): (H, W, 3) uint8 sRGB.

    Args:
        context: of this process.
        source: of the picture; of a close-up, it shows a prediction.
        person: instance id; None: the picture.

    Raises:
        UnknownName: no such kind, or it needs a function and the run has none.
        MissingInput: an object is gone.
    """
    painter, prediction = FramePainter(ProductReader(context.store)), source.prediction
    if person is None:
        return painter.paint(source.kind, capture=source.capture, prediction=prediction, annotation=source.annotation)
    if prediction is None:
        raise UnknownName("kind of picture", source.kind, FRAME_KINDS, field="kind")
    return painter.close_up(capture=source.capture, prediction=prediction, person=person)


def label_map(context: Context, source: ShownProducts) -> NDArray[np.uint8]:
    """Return the label ids that a picture of kind ``truth`` or ``prediction`` shows in colours: (H, W) uint8.

    Raises:
        UnknownName: the run has no function.
        MissingInput: an object is gone.
    """
    reader = ProductReader(context.store)
    if source.kind is PictureKind.TRUTH:
        return source.capture.seen_truth(reader).class_map
    if source.prediction is None:
        raise UnknownName("kind of labels", source.kind, ("truth",), field="kind")
    return to_label_ids(reader.prediction(source.prediction))


def _needed(kind: PictureKind, capture: Capture) -> tuple[str, ...]:
    """Return the digests of the products in a kind of picture, besides a prediction and an annotation."""
    if kind in (PictureKind.PREDICTION, PictureKind.NORMALS):
        return ()
    products = capture.products
    image, truth = (products.background, products.layer), (products.truth,)
    moving = () if capture.motion is None else (capture.motion,)
    if kind in _OF_TRUTH:
        return (*truth, *moving)
    return (*image, *moving) if kind in _OF_IMAGE and not capture.setting.needs_depth else (*image, *truth, *moving)
