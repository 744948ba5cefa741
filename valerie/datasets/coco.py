"""Data sets in COCO's formats: panoptic segmentation, and instances with amodal masks.

Categories have Cityscapes' label ids and names. A panoptic picture codes a segment's id as R + 256 G + 256² B. The id is label
id × 1000 + n for an instance, else the label id; 0 is void (Kirillov et al. 2019, arXiv:1801.00868). If a class has instances,
its pixels outside them are one segment with ``iscrowd`` 1, as in cityscapesScripts.

Amodal convention: ``segmentation``, ``bbox`` and ``area`` describe the *visible* part, so that every COCO tool measures it. An
annotation also has, named as in KINS (Qi et al. 2019, doi:10.1109/CVPR.2019.00313), ``a_segm``, ``a_bbox``, ``a_area`` of the
whole person within the image and ``i_segm``, ``i_bbox``, ``i_area`` of its visible part. A fully hidden person has no
annotation; the Parquet index lists it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NotRequired

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from valerie.datasets.frame import KeyPoints, LabelledFrame
from valerie.document import Document
from valerie.labels import BY_ID, PERSON, RIDER, TRAIN_LABELS, VOID
from valerie.measures import Cell
from valerie.plain import JsonObject


class Category(TypedDict):
    """A class; ``isthing`` is 1 if it has instances. Only classes whose annotations have key points name these."""

    id: int
    name: str
    supercategory: str
    isthing: int
    color: list[int]
    keypoints: NotRequired[list[str]]
    skeleton: NotRequired[list[list[int]]]


#: The 19 evaluated classes.
CATEGORIES: Final[tuple[Category, ...]] = tuple(
    {
        "id": label.id,
        "name": label.name,
        "supercategory": label.category,
        "isthing": int(label.has_instances),
        "color": list(label.color),
    }
    for label in TRAIN_LABELS
)


class CocoImage(TypedDict):
    """A picture, by its path below the data set."""

    id: int
    width: int
    height: int
    file_name: str


class Segment(TypedDict):
    """One entry of ``segments_info``; ``bbox`` is x, y, width, height."""

    id: int
    category_id: int
    area: int
    bbox: list[int]
    iscrowd: int


class PanopticAnnotation(TypedDict):
    """The segments of one picture."""

    image_id: int
    file_name: str
    segments_info: Sequence[Segment]


class CocoDocument(TypedDict):
    """A whole document, of instances or of panoptic segments."""

    info: dict[str, str]
    licenses: list[str]
    images: list[CocoImage]
    annotations: Sequence[JsonObject] | Sequence[PanopticAnnotation]
    categories: list[Category]


class RunLengths(TypedDict):
    """A mask in COCO's compressed run-length code; ``size`` is height and width."""

    size: list[int]
    counts: str


class MaskShape(TypedDict):
    """A mask with its box (x, y, width, height) and number of pixels."""

    segm: RunLengths
    bbox: list[int]
    area: int


class Instance(Document):
    """A visible instance of an evaluated class.

    Attributes:
        category_id: label id of its class.
        instance_id: label id × 1000 + n.
        visible: its visible pixels.
        amodal: all its pixels within the image; None where they are unknown.
        measures: measures of a person by column.
        key_points: joints of a person; None where they are unknown.
    """

    category_id: int
    instance_id: int
    visible: MaskShape
    amodal: MaskShape | None
    measures: dict[str, Cell]
    key_points: KeyPoints | None

    def annotation(self) -> JsonObject:
        """Return COCO's annotation without ``id`` and ``image_id``."""
        entry: JsonObject = {"category_id": self.category_id, "iscrowd": 0, "instance_id": self.instance_id}
        entry |= _shape_entries(self.visible, "segmentation", "")
        if self.amodal is not None:
            entry |= _shape_entries(self.amodal, "a_segm", "a_") | _shape_entries(self.visible, "i_segm", "i_")
        entry |= self.measures
        if self.key_points is not None:
            entry |= {name: self.key_points[name] for name in ("keypoints", "num_keypoints")}
        return entry


def panoptic_ids(frame: LabelledFrame) -> NDArray[np.uint32]:
    """Return the segment ids of a frame, (H, W); 0 is void."""
    evaluated = np.zeros(256, np.bool_)
    evaluated[[label.id for label in TRAIN_LABELS]] = True
    return np.where(evaluated[frame.class_map], frame.segment_ids, 0).astype(np.uint32)


def panoptic_picture(ids: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """Return the picture that codes segment ids by R + 256 G + 256² B: (H, W, 3) uint8."""
    return np.stack([ids & 255, ids >> 8 & 255, ids >> 16 & 255], axis=2).astype(np.uint8)


def panoptic_segments(ids: NDArray[np.uint32]) -> list[Segment]:
    """Return the ``segments_info`` of one picture."""
    segments: list[Segment] = []
    for number in np.unique(ids[ids > 0]).tolist():
        label = BY_ID[number // 1000 if number >= 1000 else number]
        mask = ids == number
        segments.append(
            {
                "id": number,
                "category_id": label.id,
                "area": int(np.count_nonzero(mask)),
                "bbox": _box(mask),
                "iscrowd": int(label.has_instances and number < 1000),
            }
        )
    return segments


def instance_annotations(frame: LabelledFrame) -> list[Instance]:
    """Return the visible instances of evaluated classes."""
    annotations: list[Instance] = []
    for number in np.unique(frame.instance_map[frame.instance_map > 0]).tolist():
        label = BY_ID[number // 1000]
        if label.train_id == VOID:
            continue
        amodal = frame.amodal.get(number)
        annotations.append(
            Instance(
                category_id=label.id,
                instance_id=number,
                visible=_shape(frame.instance_map == number),
                amodal=None if amodal is None else _shape(amodal),
                measures=dict(frame.persons.get(number, {})),
                key_points=frame.key_points.get(number),
            )
        )
    return annotations


def assemble(
    images: Sequence[CocoImage],
    annotations: Sequence[JsonObject] | Sequence[PanopticAnnotation],
    description: str,
    *,
    key_points: Sequence[str] = (),
    limbs: Sequence[tuple[int, int]] = (),
) -> CocoDocument:
    """Return a whole COCO document of images and annotations that have their ids.

    If an annotation has key points, ``key_points`` (their names) and ``limbs`` (pairs of indices, from 0) describe those of
    persons and riders.
    """
    pointed = any("keypoints" in annotation for annotation in annotations)
    skeleton = [[a + 1, b + 1] for a, b in limbs]
    return {
        "info": {"description": description},
        "licenses": [],
        "images": list(images),
        "annotations": annotations,
        "categories": [
            {**category, "keypoints": list(key_points), "skeleton": skeleton}
            if pointed and category["name"] in (PERSON.name, RIDER.name)
            else category
            for category in CATEGORIES
        ],
    }


def run_lengths(mask: NDArray[np.bool_]) -> RunLengths:
    """Return a mask in COCO's compressed run-length code.

    The code holds the lengths of runs in column order, starting with a run of zeros. From the fourth length on, it holds the
    difference from the length before last. Each number is written in groups of five bits, lowest first, as characters from "0";
    a sixth bit marks that more groups follow.
    """
    flat = np.asarray(mask, np.bool_).ravel(order="F")
    edges = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    lengths = np.diff(np.concatenate(([0], edges, [flat.size]))).tolist()
    if flat.size and flat[0]:
        lengths.insert(0, 0)
    code: list[str] = []
    for place, length in enumerate(lengths):
        rest = length - lengths[place - 2] if place > 2 else length
        while True:
            group = rest & 31
            rest >>= 5
            more = rest != (-1 if group & 16 else 0)
            code.append(chr(48 + (group | (32 if more else 0))))
            if not more:
                break
    return {"size": [int(mask.shape[0]), int(mask.shape[1])], "counts": "".join(code)}


def _shape_entries(shape: MaskShape, mask: str, prefix: str) -> JsonObject:
    return {
        mask: {"size": shape["segm"]["size"], "counts": shape["segm"]["counts"]},
        f"{prefix}bbox": shape["bbox"],
        f"{prefix}area": shape["area"],
    }


def _shape(mask: NDArray[np.bool_]) -> MaskShape:
    return {"segm": run_lengths(mask), "bbox": _box(mask), "area": int(np.count_nonzero(mask))}


def _box(mask: NDArray[np.bool_]) -> list[int]:
    """Return x, y, width, height; zeros for an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return [0, 0, 0, 0]
    return [int(columns[0]), int(rows[0]), int(columns[-1] - columns[0] + 1), int(rows[-1] - rows[0] + 1)]
