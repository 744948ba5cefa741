"""A function under test on a few frames, before it is registered: picture, network input, prediction and errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from valerie import plugins
from valerie.errors import InvalidInput
from valerie.labels import colorize, to_label_ids, to_train_ids
from valerie.metrics.confusion import confusion_matrix
from valerie.metrics.matrix import ConfusionMatrix
from valerie.parameters.definitions import Value
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.cards import CardRow, card_rows
from valerie.perception.documents.function import FunctionDocument
from valerie.perception.running.adaptation import plan
from valerie.pipeline.base.resolved_runs import resolve_new
from valerie.pipeline.functions.bounded import open_bounded
from valerie.pipeline.functions.opening import open_function_document
from valerie.pipeline.reading.painting import paint_errors
from valerie.rendering.base import View
from valerie.runs.document.run_spec import RunSpec
from valerie.runs.resolving.sensors import focal_length_mm, setting_of
from valerie.runs.resolving.spec import ResolvedRun
from valerie.scene.assets.asset import load_asset
from valerie.scene.variation.variant import apply
from valerie.sensing.metering import metered_ev
from valerie.sensing.sensor import Shot, develop
from valerie.settings import Settings

#: White pixels between the tiles of a sheet.
_GAP: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPicture:
    """A frame with its truth.

    Attributes:
        picture: (H, W, 3) uint8 sRGB.
        truth: (H, W) train ids.
    """

    picture: NDArray[np.uint8]
    truth: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class TriedFrame:
    """A frame and the prediction of the function.

    Attributes:
        inputs: the pieces of the picture that the network receives, each (h, w, 3) uint8 sRGB before normalisation.
        confusion: pixel counts, true class by predicted class.
        tiles: the picture, the first input, the classes of prediction and truth, and the errors, each (H, W, 3) uint8.
    """

    inputs: tuple[NDArray[np.uint8], ...]
    confusion: ConfusionMatrix
    tiles: tuple[NDArray[np.uint8], ...]


def render_frames(spec: RunSpec, settings: Settings, count: int) -> list[LabelledPicture]:
    """Render accepted variants from all of a spec by its engine, as its first camera and sensor see them.

    Raises:
        InvalidInput: the spec, or a sensor that needs depth or motion.
        MissingDependency: the engine is not installed here.
        RenderingError: the engine refuses the scene.
    """
    resolved = resolve_new(spec.model_copy(update={"functions": ()}), settings)
    asset = load_asset(spec.asset, asset_dir=settings.asset_dir)
    view = View(resolved.cameras[0], spec.resolution.width, spec.resolution.height)
    with closing(plugins.create_renderer(spec.engine, spec.engine_settings)) as engine:
        truths = plugins.create_truth_pass(engine.numeric_class)
        frames = []
        for values in _spread(resolved, count):
            sensor = setting_of(spec.sensors[0], values, moves=False)
            if sensor.needs_depth:
                raise InvalidInput("this sensor needs depth", field="sensors.0", value=sensor.name)
            scene = apply(values, asset)
            background = engine.background(scene, view)
            metered = metered_ev(background.pixels) if sensor.auto_exposure else None
            shot = Shot(focal_length_mm(resolved.manifest, view.camera, values), None, None, spec.seed, (), metered)
            picture = develop(engine.layer(scene, view).over(background).pixels, sensor, shot)
            frames.append(LabelledPicture(picture, to_train_ids(truths.truth(scene, view).class_map)))
    if not frames:
        raise InvalidInput("every variant is rejected", field="vary")
    return frames


def try_function(
    document: FunctionDocument, payload: Path | None, frames: Sequence[LabelledPicture], settings: Settings
) -> tuple[list[CardRow], list[TriedFrame]]:
    """Let a function predict on frames, within this deployment's bounds (see `open_bounded`).

    Args:
        document: complete document of the function.
        payload: its file; None for kinds without one.
        frames: frames with their truth.
        settings: of this deployment.

    Returns:
        The rows of its card without provenance, and the frames.

    Raises:
        ValerieError: the function cannot be opened, or breaks its bounds.
    """
    threads = settings.inference_threads

    def opened() -> PerceptionFunction:
        return open_function_document(document, payload, settings, threads=threads)

    with closing(open_bounded(opened, settings, name=document.name)) as function:
        trials = [_tried(document, frame, function.predict(frame.picture)) for frame in frames]
        return card_rows(replace(function.card, provenance={}), document), trials


def contact_sheet(frames: Sequence[TriedFrame]) -> NDArray[np.uint8]:
    """Return the tiles of all frames, a row for each frame, as (H, W, 3) uint8 sRGB."""
    return _joined([_joined(frame.tiles, axis=1) for frame in frames], axis=0)


def _spread(resolved: ResolvedRun, count: int) -> Iterator[dict[str, Value]]:
    """Yield the values of up to ``count`` accepted variants at the first moment, at even distances in the space."""
    size, last = resolved.space.size, -1
    for start in np.linspace(0, size, count, endpoint=False, dtype=int).tolist():
        for index in range(max(start, last + 1), size):
            values = resolved.space[index].values
            if resolved.rejection(values) is None:
                last = index
                yield dict(resolved.at(values, 0))
                break


def _tried(document: FunctionDocument, frame: LabelledPicture, predicted: NDArray[np.uint8]) -> TriedFrame:
    picture, truth = frame.picture, frame.truth
    inputs = tuple(plan(document.input, *picture.shape[:2]).pieces(picture))
    picture_seen = _fitted(inputs[0], picture.shape[0], picture.shape[1])
    classes = (colorize(to_label_ids(predicted)), colorize(to_label_ids(truth)))
    tiles = (picture, picture_seen, *classes, paint_errors(picture, truth, predicted))
    return TriedFrame(inputs, confusion_matrix(truth, predicted), tiles)


def _fitted(pixels: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Return pixels in a grey frame of a size, reduced where they are larger."""
    scale = min(1.0, height / pixels.shape[0], width / pixels.shape[1])
    rows, columns = (max(1, int(side * scale)) for side in pixels.shape[:2])
    framed = np.full((height, width, 3), 128, np.uint8)
    framed[:rows, :columns] = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA)
    return framed


def _joined(tiles: Sequence[NDArray[np.uint8]], *, axis: int) -> NDArray[np.uint8]:
    shape = list(tiles[0].shape)
    shape[axis] = _GAP
    gap = np.full(shape, 255, np.uint8)
    return np.concatenate([part for tile in tiles for part in (tile, gap)][:-1], axis=axis)
