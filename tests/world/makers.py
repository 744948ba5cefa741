"""Makers of drawn products, in the place of render engines and networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.world.street import Street
from valerie.db import runs
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.db.measured import SeenPerson
from valerie.db.publishing import Finished, SharedStatics
from valerie.labels import PERSON, VOID, to_train_ids
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.reading.person_views import NO_PERSON, seen_person
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.rendering.base import GroundTruth, View
from valerie.rendering.visibility import measure_pixels
from valerie.storage import codecs
from valerie.storage.keys import product_key

#: The train id of what is drawn where nobody stands.
ROAD = 0
#: What the drawn products say they cost.
CPU_SECONDS = {"background": 1.2, "layer": 0.4, "truth": 0.2, "prediction": 0.6}


class DrawingMaker:
    """Backgrounds, layers, truths and predictions."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._reader = ProductReader(context.store)

    def make(self, job: Job) -> Finished:
        """See `valerie.pipeline.work.stages.Maker`."""
        with reading(self._context.engine) as connection:
            resolved = resolve_stored(runs.get(connection, job.frame.key.run_id), self._context.settings).resolved
        values = {d.path: d.default for d in resolved.definitions} | job.frame.assignment
        size = resolved.spec.resolution
        view = View(resolved.cameras[job.frame.key.camera], size.width, size.height)
        street = Street(values, view)
        persons: tuple[SeenPerson, ...] = ()
        part: SharedStatics | None = None
        if job.kind == "background":
            data = codecs.encode_image(street.background())
        elif job.kind == "layer":
            data = codecs.encode_layer(street.layer())
        elif job.kind == "truth":
            truth, statics = street.truth(), street.statics()
            below = codecs.encode_truth(statics)
            part = SharedStatics(codecs.statics_digest(statics), len(below), view.width * view.height)
            self._context.store.put(product_key("statics", part.digest), below)
            data = codecs.encode_truth_layer(street.truth_layer(), part.digest)
            persons = tuple(_seen_persons(street, truth)) or (NO_PERSON,)
        else:
            assert job.look is not None
            empty = job.digest == job.look.empty
            truth = street.truth() if empty else self._reader.truth(job.frame.products.truth)
            distances = [person.distance_m for person in street.persons()]
            labels = predict(truth, job.look.function, min(distances, default=20.0), seed=int(job.digest[:8], 16))
            if empty:
                labels[labels == PERSON.train_id] = ROAD
            data = codecs.encode_prediction(labels)
        self._context.store.put(product_key(job.kind, job.digest), data)
        pixels = view.width * view.height
        return Finished(job.digest, len(data), pixels, CPU_SECONDS[job.kind], person_views=persons, part=part)


def predict(truth: GroundTruth, function: int, distance_m: float, *, seed: int) -> NDArray[np.uint8]:
    """Return the prediction of a function of middling quality: worse far away, with crumbled edges and a few false persons."""
    generator = np.random.default_rng(seed)
    labels = to_train_ids(truth.class_map).copy()
    chance = generator.random(labels.shape)
    mask = labels == PERSON.train_id
    rows = np.flatnonzero(mask.any(axis=1))
    quality = np.clip(1.25 - distance_m / (38.0 + 12.0 * function) + generator.normal(0.0, 0.1), 0.0, 1.0)
    missed = mask & (chance > quality)
    if rows.size and generator.random() < 0.5:  # legs are lost first
        missed |= mask & (np.arange(labels.shape[0])[:, None] > rows[0] + (rows[-1] - rows[0]) * quality)
    labels[missed] = 2
    if generator.random() < 0.4 and rows.size:
        column = int(generator.integers(4, labels.shape[1] - 12))
        height = max(len(rows) // 2, 3)
        labels[rows[0] : rows[0] + height, column : column + max(height // 3, 2)] = PERSON.train_id
    labels[chance < 0.002] = VOID
    return labels


def _seen_persons(street: Street, truth: GroundTruth) -> list[SeenPerson]:
    measured = zip(street.persons(), truth.persons, strict=True)
    return [
        seen_person(replace(measure_pixels(of_truth, truth), distance_m=person.distance_m, depth_m=person.depth_m))
        for person, of_truth in measured
    ]
