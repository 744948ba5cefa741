"""Makers of drawn products, in the place of render engines and networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sketch.street import Street

from valerie.db import runs
from valerie.db.engine import reading
from valerie.db.products import Finished, Job
from valerie.errors import RenderingError
from valerie.labels import PERSON, VOID, instance_id, to_train_ids
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading.products import ProductReader
from valerie.rendering.base import GroundTruth, View
from valerie.storage import codecs
from valerie.storage.keys import product_key

#: What the drawn products say they cost.
CPU_SECONDS = {"background": 1.2, "layer": 0.4, "truth": 0.2, "prediction": 0.6}


class SketchMaker:
    """Backgrounds, layers, truths and predictions.

    Args:
        context: of the process.
        broken: which jobs fail for good.
    """

    def __init__(self, context: Context, broken: Callable[[Job], bool] = lambda job: False) -> None:
        self._context, self._broken = context, broken
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        if self._broken(job):
            raise RenderingError("sketch: the image is constant (every sampled pixel is 0)")
        with reading(self._context.engine) as connection:
            resolved = resolve_stored(runs.get(connection, job.frame.key.run_id), self._context.settings).resolved
        values = {d.path: d.default for d in resolved.definitions} | job.frame.assignment
        size = resolved.spec.resolution
        view = View(resolved.cameras[job.frame.key.camera], size.width, size.height)
        street = Street(values, view)
        rows: tuple[dict[str, Any], ...] = ()
        if job.kind == "background":
            data = codecs.encode_image(street.background())
        elif job.kind == "layer":
            data = codecs.encode_layer(street.layer())
        elif job.kind == "truth":
            truth = street.truth()
            data = codecs.encode_truth(truth)
            rows = tuple(_view_row(job.digest, street, truth)) or (_nobody(job.digest),)
        else:
            assert job.look is not None
            truth = self._reader.truth(job.frame.products.truth)
            distances = [person.distance_m for person in street.persons()]
            data = codecs.encode_prediction(
                predict(truth, job.look.function, min(distances, default=20.0), seed=int(job.digest[:8], 16))
            )
        self._context.store.put(product_key(job.kind, job.digest), data)
        return Finished(job.digest, len(data), view.width * view.height, CPU_SECONDS[job.kind], person_views=rows)


def predict(truth: GroundTruth, function: int, distance_m: float, *, seed: int) -> NDArray[np.uint8]:
    """What a function of middling quality would see: worse far away, with crumbled edges and a few false persons."""
    generator = np.random.default_rng(seed)
    seen = to_train_ids(truth.class_map).copy()
    chance = generator.random(seen.shape)
    mask = seen == PERSON.train_id
    rows = np.flatnonzero(mask.any(axis=1))
    quality = np.clip(1.25 - distance_m / (38.0 + 12.0 * function) + generator.normal(0.0, 0.1), 0.0, 1.0)
    missed = mask & (chance > quality)
    if rows.size and generator.random() < 0.5:  # legs are lost first
        missed |= mask & (np.arange(seen.shape[0])[:, None] > rows[0] + (rows[-1] - rows[0]) * quality)
    seen[missed] = 2
    if generator.random() < 0.4 and rows.size:
        column = int(generator.integers(4, seen.shape[1] - 12))
        height = max(len(rows) // 2, 3)
        seen[rows[0] : rows[0] + height, column : column + max(height // 3, 2)] = PERSON.train_id
    seen[chance < 0.002] = VOID
    return seen


def _view_row(digest: str, street: Street, truth: GroundTruth) -> list[dict[str, Any]]:
    rows = []
    for person in street.persons():
        number = instance_id(PERSON, person.number)
        visible, amodal = int((truth.instance_map == number).sum()), int(person.mask.sum())
        reason = None if visible else ("fully hidden" if amodal else "outside the image")
        rows.append(
            {
                "truth": digest,
                "instance_id": number,
                "pixel_area": visible,
                "pixel_area_percent": 100.0 * visible / truth.class_map.size,
                "pixel_area_amodal": amodal,
                "occlusion_rate": 1 - visible / amodal if amodal else None,
                "truncation_rate": 1 - amodal / person.padded_pixels if person.padded_pixels else None,
                "distance_m": person.distance_m,
                "depth_m": person.depth_m,
                "box": _box(truth.instance_map == number),
                "amodal_box": _box(person.mask),
                "undefined_reason": reason,
            }
        )
    return rows


def _nobody(digest: str) -> dict[str, Any]:
    empty = dict.fromkeys(("occlusion_rate", "truncation_rate", "distance_m", "depth_m", "box", "amodal_box"))
    counts = {"instance_id": 0, "pixel_area": 0, "pixel_area_percent": 0.0, "pixel_area_amodal": 0}
    return {"truth": digest, **counts, **empty, "undefined_reason": "absent"}


def _box(mask: NDArray[np.bool_]) -> list[int] | None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return None
    return [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1]
