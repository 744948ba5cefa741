"""Annotations of a run's frames in an exported data set: arrays in files of numpy, joints as COCO's key points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from valerie.datasets.frame import FrameName
from valerie.db import results
from valerie.db.engine import reading
from valerie.errors import Conflict
from valerie.pipeline.context import Context
from valerie.pipeline.makers.inputs import ProductReader
from valerie.pipeline.selection import FrameKey
from valerie.rendering.annotations.joints import HIDDEN, OUTSIDE, VISIBLE, Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.storage.annotations import Annotation

#: What is said of a joint to COCO's flag: 0 not in the image, 1 there and not visible, 2 visible.
_COCO_FLAGS: Final = np.where(np.arange(VISIBLE + 1) >= HIDDEN, 1, 0)
_COCO_FLAGS[OUTSIDE], _COCO_FLAGS[VISIBLE] = 0, 2


def read_annotations(
    context: Context, reader: ProductReader, run_id: str, key: FrameKey, name: FrameName
) -> dict[AnnotationKind, Annotation]:
    """The annotations of one frame that are arrays.

    Raises:
        Conflict: one is not made yet.
        MissingInput: the object of one is gone.
    """
    with reading(context.engine) as connection:
        links = results.frame_annotations(connection, run_id, *key)
    found: dict[AnnotationKind, Annotation] = {}
    for kind in AnnotationKind:
        if kind in links and kind.stored:
            if links[kind].state != "done":
                raise Conflict(f"{name}: its {kind} are not there yet ({links[kind].state})")
            found[kind] = reader.annotation(kind, links[kind].product)
    return found


def write_annotations(root: Path, split: str, name: FrameName, found: Mapping[AnnotationKind, Annotation]) -> None:
    """One file per kind, ``annotations/<split>/<city>/<name>_<kind>.npz``, with the arrays under their names."""
    for kind, annotation in found.items():
        path = root / "annotations" / split / name.city / f"{name}_{kind}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            np.savez_compressed(file, **{one.name: getattr(annotation, one.name) for one in fields(annotation)})


def key_points(joints: Joints) -> dict[int, dict[str, Any]]:
    """Instance id to COCO's ``keypoints`` (x, y and flag of each joint, zeros outside of the image) and ``num_keypoints``."""
    found: dict[int, dict[str, Any]] = {}
    for i, number in enumerate(joints.instances.tolist()):
        if joints.known[i]:
            flags = _COCO_FLAGS[joints.visibility[i]]
            places = np.where(flags[:, None] > 0, joints.pixels[i], 0.0).astype(np.float64).round(2)
            rows = np.concatenate([places, flags[:, None]], axis=1)
            flat = [int(value) if k % 3 == 2 else value for k, value in enumerate(rows.ravel().tolist())]
            found[number] = {"keypoints": flat, "num_keypoints": int(np.count_nonzero(flags))}
    return found
