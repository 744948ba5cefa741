"""A person from near, on the blank engine, whose pictures are 36 pixels high."""

from __future__ import annotations

import numpy as np

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import frames
from valerie.db.engine import reading
from valerie.labels import PERSON
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.runs.products.frame_keys import FrameKey

#: 360 / 36 pixels high.
FACTOR = 10


def test_a_close_up_shows_the_person_with_a_margin_and_what_was_found(pipeline: Pipeline) -> None:
    key = FrameKey(pipeline.submit(spec(xs=1, ys=1)), 0, 0)
    pipeline.run(key.run_id)
    with reading(pipeline.context.engine) as connection:
        products = frames.get(connection, key).products
    reader = ProductReader(pipeline.context.store)
    truth = reader.truth(products.truth)
    assert np.array_equal(reader.class_map(products.truth), truth.class_map)
    columns = np.flatnonzero((truth.instance_map == 24001).any(axis=0))
    source = find_picture(pipeline.context, key, kind="errors")
    assert source.prediction is not None
    near = paint_picture(pipeline.context, source, person=24001)
    margin = max(36, len(columns)) // 2  # the person is as high as the picture
    window = slice(max(int(columns[0]) - margin, 0), int(columns[-1]) + margin + 1)
    picture = paint_picture(pipeline.context, find_picture(pipeline.context, key, kind="picture"))[:, window]
    width = FACTOR * picture.shape[1]
    assert near.shape[0] == FACTOR * picture.shape[0]
    for offset in (0, FACTOR - 1):  # every pixel of the picture is a square
        assert np.array_equal(near[offset::FACTOR, offset:width:FACTOR], picture)
    right = near[::FACTOR, -width::FACTOR]
    labels = (reader.prediction(source.prediction) == PERSON.train_id)[:, window]
    person = (truth.class_map == PERSON.id)[:, window]
    green, orange = (right[person & labels], right[person & ~labels])
    assert len(green) + len(orange)
    assert (green[:, 1] > green[:, 0]).all()
    assert (orange[:, 0] > orange[:, 1]).all()
    assert not np.ptp(right[~person & ~labels], axis=-1).any()  # grey


def test_a_person_who_is_not_seen_leaves_the_whole_frame(pipeline: Pipeline) -> None:
    key = FrameKey(pipeline.submit(spec(xs=1, ys=1)), 0, 0)
    pipeline.run(key.run_id)
    source = find_picture(pipeline.context, key, kind="errors")
    height, width = paint_picture(pipeline.context, source).shape[:2]
    near = paint_picture(pipeline.context, source, person=24999)
    assert near.shape == (FACTOR * height, 2 * FACTOR * width + 6, 3)
