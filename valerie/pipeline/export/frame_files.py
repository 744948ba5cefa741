"""The files of one exported frame, and its fragment of the documents that list all frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic import Field

from valerie.datasets import cityscapes, coco, openlabel
from valerie.datasets.camera import CameraDocument, camera_document
from valerie.datasets.cityscapes import labels_path
from valerie.datasets.frame import LabelledFrame
from valerie.datasets.index import IndexRow
from valerie.datasets.openlabel import SequenceFrame
from valerie.datasets.polygons import lost_pixels, polygons_document
from valerie.document import Document
from valerie.errors import Conflict
from valerie.measures import OF_PERSON, names_from
from valerie.pipeline.base.context import Context
from valerie.pipeline.export.export_plan import ExportPlan
from valerie.pipeline.reading.annotation_files import Arrays, annotation_arrays, find_annotations, key_points, npz
from valerie.pipeline.reading.asset_cache import AssetCache
from valerie.pipeline.reading.capture import Capture, capture_of
from valerie.pipeline.reading.person_views import measured_again
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.selection import ChosenFrame
from valerie.plain import JsonObject
from valerie.rendering.annotations.joints import Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.scene.variation.conditions import with_sun_angles
from valerie.scene.variation.variant import apply

#: Columns in a person's annotation besides masks.
_OF_PERSON: Final = ("character", *names_from(*OF_PERSON))


class CocoFragment(Document):
    """A frame's entries in the COCO documents, without their numbers.

    Attributes:
        width, height: of the image.
        file_name: of the picture.
        instances: the visible instances.
        panoptic_name: file name of the panoptic picture.
        segments: segments of the panoptic picture (`valerie.datasets.coco.Segment`).
    """

    width: int
    height: int
    file_name: str
    instances: tuple[coco.Instance, ...]
    panoptic_name: str
    segments: tuple[coco.Segment, ...]


class OpenLabelFragment(Document):
    """A frame's part of the OpenLABEL document of its sequence.

    Attributes:
        sequence: path of the document below its folder, without suffix.
        number: number of the frame in the sequence.
        camera: entries of the camera.
        frame: picture and objects.
    """

    sequence: str
    number: int
    camera: JsonObject
    frame: SequenceFrame


class Fragment(Document):
    """The entries of one frame in the documents that list all frames.

    Attributes:
        name: name of the frame.
        split: its split.
        coco, openlabel: None if that format is not requested.
        rows: rows of the index, one per person; empty if that format is not requested.
        lost: `lost_pixels` of the frame's polygons; empty if they are not requested.
    """

    name: str
    split: str
    coco: CocoFragment | None = None
    openlabel: OpenLabelFragment | None = None
    rows: list[IndexRow] = Field(default=[])
    lost: dict[str, tuple[int, int]] = Field(default={})


class FrameWriter:
    """Writes the files of one frame after the other.

    Args:
        context: context of this process.
        plan: plan of the export.
    """

    def __init__(self, context: Context, plan: ExportPlan) -> None:
        self._context, self._plan = context, plan
        self._assets = AssetCache(context.settings)
        self._reader = ProductReader(context.store)

    def write(self, frame: ChosenFrame, root: Path) -> Fragment:
        """Write a frame's files below a folder.

        Raises:
            Conflict: an annotation is not available yet, or failed for good.
            MissingInput: an object is gone.
        """
        plan = self._plan
        split, formats, name = plan.split(frame), plan.settings.formats, plan.name(frame)
        capture = capture_of(plan.run.resolved, frame.stored, plan.sensor)
        if capture.distorted:
            truth = capture.seen_truth(self._reader)
            frame = replace(frame, persons=tuple(measured_again(person, truth) for person in frame.persons))
        annotations = self._annotations(frame)
        for kind, arrays in annotations.items():
            path = root / "annotations" / split / name.city / f"{name}_{kind}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(npz(arrays))
        labelled = self._labelled(frame, capture, annotations.get(AnnotationKind.JOINTS))
        picture = cityscapes.write_picture(root, split, labelled)
        lost: dict[str, tuple[int, int]] = {}
        if "cityscapes" in formats:
            polygons = polygons_document(labelled.segment_ids) if plan.settings.polygons else None
            cityscapes.write_labels(root, split, labelled, polygons)
            if polygons is not None:
                lost = lost_pixels(polygons, labelled.class_map)
        for function, predictions in plan.predictions.items():
            prediction = self._reader.prediction(predictions[frame.key].digest)
            cityscapes.write_prediction(root, split, name, function, prediction)
        instances = coco.instance_annotations(labelled) if {"coco", "openlabel"} & set(formats) else []
        return Fragment(
            name=str(name),
            split=split,
            coco=self._coco(root, labelled, split, picture, instances) if "coco" in formats else None,
            openlabel=_openlabel(labelled, picture, instances) if "openlabel" in formats else None,
            rows=self._rows(frame, labelled, split, picture) if "parquet" in formats else [],
            lost=lost,
        )

    def _coco(
        self, root: Path, labelled: LabelledFrame, split: str, picture: Path, instances: Sequence[coco.Instance]
    ) -> CocoFragment:
        """Write the panoptic picture; return the frame's entries."""
        height, width = labelled.class_map.shape
        ids = coco.panoptic_ids(labelled)
        panoptic = f"{labelled.name}_panoptic.png"
        cityscapes.save_png(root / "coco" / f"panoptic_{split}" / panoptic, coco.panoptic_picture(ids))
        return CocoFragment(
            width=width,
            height=height,
            file_name=picture.relative_to(Path("leftImg8bit", split)).as_posix(),
            instances=tuple(instances),
            panoptic_name=panoptic,
            segments=tuple(coco.panoptic_segments(ids)),
        )

    def _rows(self, frame: ChosenFrame, labelled: LabelledFrame, split: str, picture: Path) -> list[IndexRow]:
        """Return the frame's rows of the index."""
        resolved = self._plan.run.resolved
        height, width = labelled.class_map.shape
        with_labels = "cityscapes" in self._plan.settings.formats
        files = {
            "name": str(labelled.name),
            "split": split,
            "width": width,
            "height": height,
            "picture": picture.as_posix(),
            "label_ids": labels_path(split, labelled.name, "labelIds.png").as_posix() if with_labels else None,
        }
        values = with_sun_angles(frame.values, resolved.manifest)
        parameters = {d.path: values.get(d.path, d.default) for d in resolved.definitions}
        return [
            {
                **files,
                **frame.row(person, resolved),
                "box": person.box,
                "amodal_box": person.amodal_box,
                **parameters,
            }
            for person in frame.persons
        ]

    def _annotations(self, frame: ChosenFrame) -> dict[AnnotationKind, Arrays]:
        try:
            products = find_annotations(self._context, frame.key, self._plan.kinds)
        except Conflict as error:
            raise Conflict(f"{self._plan.name(frame)}: {error}") from error
        return {
            kind: annotation_arrays(self._context, self._reader, frame.key.run_id, kind, product)
            for kind, product in products.items()
        }

    def _labelled(self, frame: ChosenFrame, capture: Capture, joints: Arrays | None) -> LabelledFrame:
        truth = capture.seen_truth(self._reader)
        rows = {person.instance_id: frame.row(person, self._plan.run.resolved) for person in frame.persons}
        # Joints are of the pinhole camera.
        points = key_points(Joints(**joints)) if joints is not None and not capture.distorted else {}
        return LabelledFrame(
            name=self._plan.name(frame),
            picture=capture.picture(self._reader),
            class_map=truth.class_map,
            instance_map=truth.instance_map,
            camera=self._camera(frame, capture)
            if {"cityscapes", "openlabel"} & set(self._plan.settings.formats)
            else None,
            amodal={person.instance_id: person.amodal for person in truth.persons},
            persons={number: {name: row[name] for name in _OF_PERSON} for number, row in rows.items() if number},
            key_points=points,
        )

    def _camera(self, frame: ChosenFrame, capture: Capture) -> CameraDocument:
        """Return the document of the frame's camera, with the focal length of the picture."""
        run = self._plan.run
        size = run.resolved.spec.resolution
        scene = apply(frame.moment, self._assets.of(run))
        camera = scene.cameras[run.resolved.cameras[frame.key.camera]]
        zoomed = replace(camera, focal_length_mm=camera.focal_length_mm * capture.zoom(size.width, size.height))
        return camera_document(zoomed, size.width, size.height)


def _openlabel(labelled: LabelledFrame, picture: Path, instances: Sequence[coco.Instance]) -> OpenLabelFragment:
    name = labelled.name
    assert labelled.camera is not None, "this format needs the camera"
    height, width = labelled.class_map.shape
    return OpenLabelFragment(
        sequence=f"{name.city}/{name.city}_{name.sequence}",
        number=int(name.frame),
        camera=openlabel.camera_entries(labelled.camera, width, height),
        frame=SequenceFrame(picture.as_posix(), openlabel.labelled_objects(instances)),
    )
