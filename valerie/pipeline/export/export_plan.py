"""The plan of an export: the user's request, and the finished frames that it selects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypedDict

from pydantic import Field, JsonValue, field_validator

from valerie.datasets.frame import FrameName
from valerie.db import results
from valerie.db.archives import reading_run
from valerie.db.results import StoredPrediction
from valerie.document import Document
from valerie.errors import Conflict, InvalidInput
from valerie.parameters.assignment import digest
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.pipeline.reading.annotation_files import chosen_annotations
from valerie.pipeline.reading.selection import (
    ChosenFrame,
    choose_frames,
    function_index,
    require_some,
    run_where,
    sensor_index,
)
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.frame_keys import FrameKey

Format = Literal["cityscapes", "coco", "openlabel", "parquet"]
FORMATS: Final[tuple[Format, ...]] = ("cityscapes", "coco", "openlabel", "parquet")
FORMAT_NAME: Final = "valerie-dataset/1"
#: Bytes per pixel, rounded up: a picture's PNG, labels and colours, a prediction.
_PICTURE_BYTES, _LABEL_BYTES, _PREDICTION_BYTES = 2.5, 0.3, 0.1
#: Likewise for annotations with a value in each pixel.
_ANNOTATION_BYTES: Final = {AnnotationKind.NORMALS: 3.0, AnnotationKind.FLOW: 7.0, AnnotationKind.VELOCITY: 7.0}


class ExportSettings(Document):
    """The request of a user.

    Attributes:
        formats: files to write; ``parquet`` is the index.
        where: expression that selects frames by at least one person's row; empty: all.
        splits: split to share of the variants; the frames of one variant stay together.
        sensor: name of the sensor setting of the pictures; None: the run's first.
        predictions: functions whose predictions are also exported.
        annotations: kinds to export; None: all that the run requested.
        polygons: also write Cityscapes' polygons.
    """

    formats: tuple[Format, ...] = FORMATS
    where: str = ""
    splits: dict[str, float] = Field(default={"val": 1.0}, min_length=1)
    sensor: str | None = None
    predictions: tuple[str, ...] = ()
    annotations: tuple[str, ...] | None = None
    polygons: bool = False

    @field_validator("splits")
    @classmethod
    def _shares(cls, splits: dict[str, float]) -> dict[str, float]:
        if any(not share > 0 for share in splits.values()) or abs(sum(splits.values()) - 1.0) > 1e-6:
            raise InvalidInput("shares are positive and add up to 1", field="splits", value=splits)
        for name in splits:
            FrameName(name, "0", "0")  # the same letters
        return splits

    def split_of(self, run_id: str, variant: int) -> str:
        """Return the split of a variant; it depends only on run and index."""
        place = int(digest("split", run_id, variant)[:12], 16) / 16.0**12
        names = list(self.splits)
        for name in names[:-1]:
            place -= self.splits[name]
            if place < 0:
                return name
        return names[-1]


class ExportRequest(TypedDict):
    """The document that must be equal for continuing an interrupted export.

    Attributes:
        format: format of the data set.
        run: id of the run.
        settings: `ExportSettings`.
        annotations: kinds of annotations.
        frames: number of frames.
        frames_digest: digest of their names and products.
    """

    format: str
    run: str
    settings: dict[str, JsonValue]
    annotations: list[str]
    frames: int
    frames_digest: str


@dataclass(frozen=True, slots=True, eq=False)
class ExportPlan:
    """The frames, predictions and annotations to export.

    Attributes:
        run: the run.
        settings: the request.
        sensor: index of the sensor setting.
        kinds: kinds of annotations.
        frames: the frames in order.
        predictions: function to the predictions of all frames.
        left_out: number of finished frames that were not selected.
    """

    run: StoredRun
    settings: ExportSettings
    sensor: int
    kinds: tuple[AnnotationKind, ...]
    frames: Sequence[ChosenFrame]
    predictions: Mapping[str, Mapping[FrameKey, StoredPrediction]]
    left_out: int

    @property
    def bytes(self) -> float:
        """Upper bound on the total size of the files."""
        size, settings = self.run.resolved.spec.resolution, self.settings
        of_pixel = _PICTURE_BYTES + _LABEL_BYTES * len(settings.formats)
        of_pixel += _PREDICTION_BYTES * len(settings.predictions)
        of_pixel += sum(_ANNOTATION_BYTES.get(kind, 0.0) for kind in self.kinds)
        return len(self.frames) * size.width * size.height * of_pixel

    def name(self, frame: ChosenFrame) -> FrameName:
        """Return the name of a frame's files."""
        resolved, key = self.run.resolved, frame.key
        return FrameName.of(f"{resolved.spec.name}-{resolved.cameras[key.camera]}", key.variant, key.time)

    def split(self, frame: ChosenFrame) -> str:
        """Return the split of a frame."""
        return self.settings.split_of(self.run.id, frame.key.variant)

    def request(self) -> ExportRequest:
        """Return the document that must be equal for continuing an interrupted export."""
        links = [[str(frame.key), *frame.stored.products.required] for frame in self.frames]
        return {
            "format": FORMAT_NAME,
            "run": self.run.id,
            "settings": self.settings.model_dump(mode="json"),
            "annotations": [kind.value for kind in self.kinds],
            "frames": len(self.frames),
            "frames_digest": digest("dataset", *links),
        }


def plan_export(context: Context, run: StoredRun, settings: ExportSettings) -> ExportPlan:
    """Select the frames, predictions and annotations to export.

    Raises:
        InvalidInput, UnknownName: the settings do not fit the run, or select nothing.
        Conflict: a frame lacks a requested prediction.
    """
    resolved = run.resolved
    where = run_where(settings.where, resolved) if settings.where else None
    kinds = chosen_annotations(settings.annotations, resolved)
    sensor = sensor_index(settings.sensor, resolved)
    with reading_run(context.engine, run.id) as connection:
        finished = choose_frames(connection, run, sensor=sensor)
        frames = choose_frames(connection, run, where=where, sensor=sensor) if where else finished
        require_some(frames, where)
        predictions = {
            name: results.predictions(connection, run.id, sensor, function_index(name, resolved))
            for name in settings.predictions
        }
    for name, of_function in predictions.items():
        missing = sum(1 for frame in frames if frame.key not in of_function)
        if missing:
            raise Conflict(f"{missing} of {len(frames)} frames have no prediction of {name} yet")
    return ExportPlan(run, settings, sensor, kinds, frames, predictions, len(finished) - len(frames))
