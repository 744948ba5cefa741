"""A run's frames as a data set in files: Cityscapes layout, COCO, a Parquet index.

Everything is written into a hidden folder beside the target, one frame after the other, each sealed by a fragment of the
documents that speak of all frames; at the end these are joined and the folder gets its name. So the target is whole or
not there, and the same request goes on where it was interrupted.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import pyarrow as pa
import pyarrow.compute
from pydantic import BaseModel, ConfigDict, Field, field_validator

from valerie.analysis.table import PARAMETER_COLUMNS
from valerie.datasets import cityscapes, coco
from valerie.datasets.camera import camera_document
from valerie.datasets.cityscapes import labels_path
from valerie.datasets.frame import FrameName, LabelledFrame
from valerie.datasets.index import COLUMNS, write_index
from valerie.db import results
from valerie.db.engine import reading
from valerie.db.results import StoredPrediction
from valerie.errors import Conflict, InvalidInput, StorageFull, StorageUnavailable
from valerie.measures import OF_PERSON, names_from
from valerie.parameters.assignment import digest
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import StoredRun
from valerie.pipeline.export.folder import FRAGMENTS, close_partial, open_partial, require_free_name, require_room
from valerie.pipeline.reading.annotation_files import (
    Arrays,
    annotation_arrays,
    chosen_annotations,
    find_annotations,
    key_points,
    npz,
)
from valerie.pipeline.reading.capture import Capture, capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.products import ProductReader
from valerie.pipeline.reading.run_cache import RunCache
from valerie.pipeline.reading.selection import (
    ChosenFrame,
    choose_frames,
    function_index,
    require_some,
    run_where,
    sensor_index,
)
from valerie.pipeline.reading.tables import read_table
from valerie.rendering.annotations.joints import LIMBS, Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.frames import FrameKey, FrameProducts
from valerie.scene.graph.model import JOINTS
from valerie.scene.variation.applying import apply
from valerie.scene.variation.conditions import with_sun_angles

Format = Literal["cityscapes", "coco", "parquet"]
FORMATS: Final[tuple[Format, ...]] = ("cityscapes", "coco", "parquet")
#: Describes a finished data set.
DOCUMENT: Final = "dataset.json"
FORMAT_NAME: Final = "valerie-dataset/1"
#: Bytes per pixel to be on the safe side: a picture's PNG, labels and colours, a prediction.
_PICTURE_BYTES, _LABEL_BYTES, _PREDICTION_BYTES = 2.5, 0.3, 0.1
#: The same of annotations with a value in each pixel.
_ANNOTATION_BYTES: Final = {AnnotationKind.NORMALS: 3.0, AnnotationKind.FLOW: 7.0, AnnotationKind.VELOCITY: 7.0}
#: What a person's annotation carries beside masks.
_OF_PERSON: Final = ("character", *names_from(*OF_PERSON))


class ExportSettings(BaseModel):
    """What to export.

    Attributes:
        formats: which files; ``parquet`` is the index.
        where: which frames: an expression that at least one person's row of the frame meets; empty: all.
        splits: split to share of the variants; the frames of one variant stay together.
        sensor: name of the sensor setting that the pictures are made with; None: the run's first.
        predictions: functions whose predictions are exported too.
        annotations: kinds to take along; None: all that the run asked for.
        polygons: also write Cityscapes' polygons.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

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
        """Which split a variant belongs to: its place in the unit interval follows from run and index alone."""
        place = int(digest("split", run_id, variant)[:12], 16) / 16.0**12
        names = list(self.splits)
        for name in names[:-1]:
            place -= self.splits[name]
            if place < 0:
                return name
        return names[-1]


@dataclass(frozen=True, slots=True)
class ExportProgress:
    """How far an export is.

    Attributes:
        done, total: frames.
        resumed: of ``done``, frames that an earlier attempt had written.
        frames_per_s: of this attempt; 0 before the first frame.
    """

    done: int
    total: int
    resumed: int
    frames_per_s: float


@dataclass(frozen=True, slots=True)
class Exported:
    """What an export made.

    Attributes:
        folder: the data set.
        frames: per split.
        left_out: finished frames of the run that were not selected.
    """

    folder: Path
    frames: Mapping[str, int]
    left_out: int


def export_run(
    context: Context,
    run_id: str,
    out: Path,
    settings: ExportSettings = ExportSettings(),  # noqa: B008  # frozen
    *,
    progress: Callable[[ExportProgress], None] = lambda _: None,
) -> Exported:
    """Write the frames of a run as a data set.

    Args:
        context: database and artifact store.
        run_id: of a run with finished frames; it need not be complete.
        out: folder to make; must not exist, or be empty.
        settings: what to export.
        progress: called after every frame.

    Raises:
        NotFound: no such run.
        Conflict: ``out`` holds something.
        InvalidInput, UnknownName: the settings do not fit the run, or select nothing.
        StorageFull: there is not enough room; nothing was written.
        StorageUnavailable: ``out`` cannot be written. What was written so far is taken up by the same export again.
    """
    runs = RunCache(context)
    run = runs.run(run_id)
    resolved = run.resolved
    where = run_where(settings.where, resolved) if settings.where else None
    kinds = chosen_annotations(settings.annotations, resolved)
    sensor = sensor_index(settings.sensor, resolved)
    require_free_name(out)
    with reading(context.engine) as connection:
        everything = choose_frames(connection, run, sensor=sensor)
        frames = choose_frames(connection, run, where=where, sensor=sensor) if where else everything
        require_some(frames, where)
        predicted = {
            name: results.predictions(connection, run_id, sensor, function_index(name, resolved))
            for name in settings.predictions
        }
    for name, found in predicted.items():
        missing = sum(1 for frame in frames if frame.key not in found)
        if missing:
            raise Conflict(f"{missing} of {len(frames)} frames have no prediction of {name} yet")
    size = resolved.spec.resolution
    needed = len(frames) * size.width * size.height * _bytes_per_pixel(settings, kinds)
    require_room(out, needed, f"{len(frames):,} frames", context.settings.min_free_mb)
    export = _Export(context, runs, run, settings, sensor, predicted, kinds)
    partial = out.with_name(f".{out.name}.partial")
    try:
        open_partial(partial, export.request(frames))
        _write_frames(export, frames, partial, progress)
        counts = _finish(export, frames, partial)
        if out.exists():
            out.rmdir()
        partial.rename(out)
    except OSError as error:
        if error.errno == 28:  # ENOSPC
            raise StorageFull(f"no space left for {out}; the same export goes on when there is") from error
        raise StorageUnavailable(f"{out} cannot be written: {error.strerror or error}") from error
    return Exported(out, counts, len(everything) - len(frames))


class _Export:
    """What writing one frame needs."""

    def __init__(
        self,
        context: Context,
        runs: RunCache,
        run: StoredRun,
        settings: ExportSettings,
        sensor: int,
        predicted: Mapping[str, Mapping[FrameKey, StoredPrediction]],
        kinds: tuple[AnnotationKind, ...],
    ) -> None:
        self.context, self.settings, self.sensor = context, settings, sensor
        self.kinds = kinds
        self.run, self.resolved = run, run.resolved
        self._runs, self._predicted = runs, predicted
        self._reader = ProductReader(context.store)

    def request(self, frames: Sequence[ChosenFrame]) -> dict[str, Any]:
        """What must be equal for an interrupted export to go on."""
        links = [[str(frame.key), *_shown(frame.stored.products)] for frame in frames]
        return {
            "format": FORMAT_NAME,
            "run": self.run.id,
            "settings": self.settings.model_dump(mode="json"),
            "annotations": [kind.value for kind in self.kinds],
            "frames": len(frames),
            "frames_digest": digest("dataset", *links),
        }

    def name(self, frame: ChosenFrame) -> FrameName:
        key = frame.key
        return FrameName.of(f"{self.resolved.spec.name}-{self.resolved.cameras[key.camera]}", key.variant, key.time)

    def split(self, frame: ChosenFrame) -> str:
        return self.settings.split_of(self.run.id, frame.key.variant)

    def write(self, frame: ChosenFrame, root: Path) -> dict[str, Any]:
        """Write one frame's files; its fragment of the common documents."""
        split, formats = self.split(frame), self.settings.formats
        capture = capture_of(self.resolved, frame.stored, self.sensor)
        if capture.distorted:
            seen = capture.seen_truth(self._reader)
            frame = replace(frame, persons=tuple(measured_again(row, seen) for row in frame.persons))
        annotations = self._annotations(frame)
        for kind, arrays in annotations.items():
            path = root / "annotations" / split / self.name(frame).city / f"{self.name(frame)}_{kind}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(npz(arrays))
        made = self._labelled(frame, capture, annotations.get(AnnotationKind.JOINTS))
        picture = cityscapes.write_picture(root, split, made)
        height, width = made.class_map.shape
        fragment: dict[str, Any] = {"name": str(made.name), "split": split}
        labels = ""
        if "cityscapes" in formats:
            cityscapes.write_labels(root, split, made, polygons=self.settings.polygons)
            labels = labels_path(split, made.name, "labelIds.png").as_posix()
        for function, found in self._predicted.items():
            prediction = self._reader.prediction(found[frame.key].digest)
            cityscapes.write_prediction(root, split, made.name, function, prediction)
        if "coco" in formats:
            ids = coco.panoptic_ids(made)
            panoptic = f"{made.name}_panoptic.png"
            cityscapes.save_png(root / "coco" / f"panoptic_{split}" / panoptic, coco.panoptic_picture(ids))
            file = picture.relative_to(Path("leftImg8bit", split)).as_posix()
            fragment["image"] = {"width": width, "height": height, "file_name": file}
            fragment["annotations"] = coco.instance_annotations(made)
            fragment["panoptic"] = {"file_name": panoptic, "segments_info": coco.panoptic_segments(ids)}
        if "parquet" in formats:
            files = {"picture": picture.as_posix(), "label_ids": labels or None}
            known = {"name": str(made.name), "split": split, "width": width, "height": height, **files}
            given = with_sun_angles(frame.values, self.resolved.manifest)
            values = {d.path: given.get(d.path, d.default) for d in self.resolved.definitions}
            fragment["rows"] = [{**known, **row, **values} for row in frame.persons]
        return fragment

    def _annotations(self, frame: ChosenFrame) -> dict[AnnotationKind, Arrays]:
        try:
            found = find_annotations(self.context, frame.key, self.kinds)
        except Conflict as error:
            raise Conflict(f"{self.name(frame)}: {error}") from error
        return {kind: annotation_arrays(self.context, self._reader, kind, product) for kind, product in found.items()}

    def _labelled(self, frame: ChosenFrame, capture: Capture, joints: Arrays | None) -> LabelledFrame:
        spec = self.resolved.spec
        truth = capture.seen_truth(self._reader)
        camera: dict[str, Any] = {}
        if "cityscapes" in self.settings.formats:
            scene = apply(frame.moment, self._runs.asset(self.run))
            size = spec.resolution
            own = scene.cameras[self.resolved.cameras[frame.key.camera]]
            own = replace(own, focal_length_mm=own.focal_length_mm * capture.zoom(size.width, size.height))
            camera = camera_document(own, size.width, size.height)
        persons = {
            row["instance_id"]: {name: row[name] for name in _OF_PERSON}
            for row in frame.persons
            if row["instance_id"] is not None
        }
        # Joints are of the pin-hole camera.
        if joints is not None and not capture.distorted:
            for number, points in key_points(Joints(**joints)).items():
                persons.setdefault(number, {}).update(points)
        return LabelledFrame(
            name=self.name(frame),
            picture=capture.picture(self._reader),
            class_map=truth.class_map,
            instance_map=truth.instance_map,
            camera=camera,
            amodal={person.instance_id: person.amodal for person in truth.persons},
            persons=persons,
        )


def _write_frames(
    export: _Export, frames: Sequence[ChosenFrame], partial: Path, progress: Callable[[ExportProgress], None]
) -> None:
    started, made, resumed = time.monotonic(), 0, 0
    for done, frame in enumerate(frames, start=1):
        fragment = partial / FRAGMENTS / f"{export.name(frame)}.json"
        if fragment.is_file():
            resumed += 1
        else:
            document = export.write(frame, partial)
            unsealed = fragment.with_suffix(".part")
            unsealed.write_text(json.dumps(document))
            unsealed.replace(fragment)  # from here on the frame counts as written
            made += 1
        elapsed = time.monotonic() - started
        progress(ExportProgress(done, len(frames), resumed, made / elapsed if elapsed > 0 else 0.0))


def _finish(export: _Export, frames: Sequence[ChosenFrame], partial: Path) -> dict[str, int]:
    """Join the fragments into the documents that speak of all frames; frames per split."""
    settings, resolved = export.settings, export.resolved
    counts: dict[str, int] = {}
    for fragment in _fragments(export, frames, partial):
        counts[fragment["split"]] = counts.get(fragment["split"], 0) + 1
    description = f"VALERIE run {export.run.id} ({resolved.spec.name})"
    if "coco" in settings.formats:
        for split in counts:
            of_split = (one for one in _fragments(export, frames, partial) if one["split"] == split)
            _write_coco(partial / "coco", split, of_split, description)
    if "parquet" in settings.formats:
        types = {d.path: _plain(PARAMETER_COLUMNS[d.type.value]) for d in resolved.definitions}
        rows = (row for fragment in _fragments(export, frames, partial) for row in fragment["rows"])
        write_index(partial / "index.parquet", rows, types)
    if settings.predictions:
        _write_evaluations(export, frames, partial / "evaluations.parquet")
    document = {
        **export.request(frames),
        "description": description,
        "splits": counts,
        "asset": resolved.spec.model_dump(mode="json")["asset"],
        "asset_digest": resolved.asset_digest,
        "pins": export.run.pins.model_dump(mode="json", exclude_none=True),
        "sensor": resolved.spec.sensors[export.sensor].model_dump(mode="json"),
        "classes": "Cityscapes label ids; instance ids are label id × 1000 + n",
        "index_columns": {name: text for name, _, text in COLUMNS} if "parquet" in settings.formats else {},
    }
    (partial / DOCUMENT).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    close_partial(partial)
    return counts


def _write_coco(folder: Path, split: str, fragments: Iterator[dict[str, Any]], description: str) -> None:
    images: list[dict[str, Any]] = []
    instances: list[dict[str, Any]] = []
    panoptic: list[dict[str, Any]] = []
    for number, fragment in enumerate(fragments, start=1):
        images.append({"id": number, **fragment["image"]})
        panoptic.append({"image_id": number, **fragment["panoptic"]})
        for annotation in fragment["annotations"]:
            instances.append({"id": len(instances) + 1, "image_id": number, **annotation})
    for name, entries in (("instances", instances), ("panoptic", panoptic)):
        document = coco.assemble(images, entries, description, key_points=JOINTS, limbs=LIMBS)
        (folder / f"{name}_{split}.json").write_text(json.dumps(document))


def _write_evaluations(export: _Export, frames: Sequence[ChosenFrame], path: Path) -> None:
    """The long table's rows of the exported frames and functions."""
    table = read_table(export.context.engine, export.run)
    wanted = {str(frame.key) for frame in frames}
    ids = pa.compute.is_in(table.arrow["frame_id"], pa.array(sorted(wanted))).to_numpy()
    chosen = ids & table.codes("sensor").where(export.resolved.spec.sensors[export.sensor].name)
    functions = table.codes("function")
    named = functions.where(export.settings.predictions[0])
    for name in export.settings.predictions[1:]:
        named = named | functions.where(name)
    table.select(chosen & named).to_parquet(path)


def _fragments(export: _Export, frames: Sequence[ChosenFrame], partial: Path) -> Iterator[dict[str, Any]]:
    for frame in frames:
        fragment: dict[str, Any] = json.loads((partial / FRAGMENTS / f"{export.name(frame)}.json").read_bytes())
        yield fragment


def _bytes_per_pixel(settings: ExportSettings, kinds: Sequence[AnnotationKind]) -> float:
    """Of all files of one frame, at most."""
    labels = _PICTURE_BYTES + _LABEL_BYTES * len(settings.formats) + _PREDICTION_BYTES * len(settings.predictions)
    return labels + sum(_ANNOTATION_BYTES.get(kind, 0.0) for kind in kinds)


def _shown(products: FrameProducts) -> tuple[str, str, str]:
    return products.background, products.layer, products.truth


def _plain(dtype: pa.DataType) -> pa.DataType:
    return pa.string() if pa.types.is_dictionary(dtype) else dtype
