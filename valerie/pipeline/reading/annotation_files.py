"""Annotations as files for other tools: numpy's archives of arrays, joints as COCO's key points."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from valerie.datasets.frame import KeyPoints
from valerie.db import frames, measured
from valerie.db.archives import reading_run
from valerie.errors import Conflict, UnknownName
from valerie.measures import Source, names_from
from valerie.pipeline.base.context import Context
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.annotations.joints import HIDDEN, OUTSIDE, VISIBLE, Joints
from valerie.rendering.annotations.kinds import AnnotationKind
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import ProductState
from valerie.runs.resolving.spec import ResolvedRun

#: Array name to array, as `numpy.load` returns them.
Arrays = Mapping[str, NDArray[Any]]
#: Raise it whenever equal products give other bytes.
FILES_REVISION: Final = 1
#: COCO's flag of each visibility of a joint: 0 not in the image, 1 in it and hidden, 2 visible.
_COCO_FLAGS: Final = np.where(np.arange(VISIBLE + 1) >= HIDDEN, 1, 0)
_COCO_FLAGS[OUTSIDE], _COCO_FLAGS[VISIBLE] = 0, 2


def chosen_annotations(names: Sequence[str] | None, resolved: ResolvedRun) -> tuple[AnnotationKind, ...]:
    """Return the kinds with these names, each once; without names, those that the spec requests.

    Raises:
        UnknownName: the run has no annotation of this name.
    """
    known = resolved.annotations
    for name in names or ():
        if name not in known:
            raise UnknownName("annotation of the run", name, known, field="annotations")
    return resolved.spec.annotations if names is None else tuple(kind for kind in known if kind in names)


def find_annotations(context: Context, key: FrameKey, kinds: Sequence[str]) -> dict[AnnotationKind, str]:
    """Return kind to product of a frame's annotations, all of them stored.

    Raises:
        NotFound: no such frame.
        UnknownName: the run has no annotation of such a kind.
        Conflict: one is not available yet, or failed for good.
    """
    with reading_run(context.engine, key.run_id) as connection:
        frames.get(connection, key)
        links = frames.annotation_links(connection, key)
    for kind in kinds:
        if kind not in links:
            raise UnknownName("annotation of the run", kind, tuple(links), field="annotations")
        if links[kind].state == ProductState.FAILED:
            raise Conflict(f"{kind} failed for good; `valerie retry {key.run_id}` tries again")
        if links[kind].state != ProductState.DONE:
            raise Conflict(f"{kind} is not made yet ({links[kind].state})")
    return {AnnotationKind(kind): links[kind].product for kind in kinds}


def annotation_arrays(
    context: Context, reader: ProductReader, run_id: str, kind: AnnotationKind, product: str
) -> Arrays:
    """Read the arrays of one annotation of a run: the stored ones, or for ``light`` the columns, with one entry per person.

    Raises:
        MissingInput: its object is gone.
    """
    if kind.stored:
        stored = reader.annotation(kind, product)
        return {field.name: getattr(stored, field.name) for field in fields(stored)}
    with reading_run(context.engine, run_id) as connection:
        persons = measured.person_lights(connection, product)
    # Undefined values (no sun, nothing visible) are NaN.
    values = {
        name: np.array([person.measures[name] for person in persons], np.float64) for name in names_from(Source.LIGHT)
    }
    return {"instances": np.array([person.instance_id for person in persons], np.int64), **values}


def npz(arrays: Arrays) -> bytes:
    """Return an archive that `numpy.load` reads; equal arrays give equal bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def key_points(joints: Joints) -> dict[int, KeyPoints]:
    """Return instance id to COCO's ``keypoints`` (x, y and flag of each joint, zeros outside the image) and ``num_keypoints``."""
    points: dict[int, KeyPoints] = {}
    for i, number in enumerate(joints.instances.tolist()):
        if joints.known[i]:
            flags = _COCO_FLAGS[joints.visibility[i]]
            places = np.where(flags[:, None] > 0, joints.pixels[i], 0.0).astype(np.float64).round(2)
            rows = np.concatenate([places, flags[:, None]], axis=1)
            flat = [int(value) if k % 3 == 2 else value for k, value in enumerate(rows.ravel().tolist())]
            points[number] = KeyPoints(keypoints=flat, num_keypoints=int(np.count_nonzero(flags)))
    return points
