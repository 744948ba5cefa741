"""Functions also see the background without movables: `pacc_empty` beside `pacc`."""

from __future__ import annotations

import numpy as np

from tests.world.blank import SMALL, Pipeline
from valerie.db import frames
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import Stage
from valerie.runs.resolving.spec import parse
from valerie.sensing.sensor import develop
from valerie.sensing.settings import SensorSetting
from valerie.storage.keys import product_key
from valerie.testing.blank import BlankFunction

FRAMES = 24
BACKGROUNDS = 2
EMPTY = SMALL | {"infer_backgrounds": True}


def test_each_background_is_inferred_once_and_scored_under_the_mask_of_every_person(pipeline: Pipeline) -> None:
    run = pipeline.submit(EMPTY)
    assert pipeline.run(run) == "completed"
    assert pipeline.made()["prediction"] == FRAMES + BACKGROUNDS
    key = FrameKey(run, 3, 1)
    reader = ProductReader(pipeline.context.store)
    with reading(pipeline.context.engine) as connection:
        products = frames.get(connection, key).products
    picture = develop(reader.background(products.background).pixels, SensorSetting())
    called_person = BlankFunction().predict(picture) == 11
    truth = reader.truth(products.truth)
    table = read_table(pipeline.context.engine, read_run(pipeline.context, run))
    rows = [row for row in table.arrow.to_pylist() if row["frame_id"] == str(key)]
    assert {row["instance_id"] for row in rows} == {24001, 24002}
    for row in rows:
        mask = truth.instance_map == row["instance_id"]
        assert row["pacc_empty"] == (np.mean(called_person[mask]) if mask.any() else None)


def test_nothing_but_evaluations_is_made_anew(pipeline: Pipeline) -> None:
    first = pipeline.submit()
    assert pipeline.run(first) == "completed"
    pipeline.made()
    second = pipeline.submit(EMPTY)
    planned = plan_run(pipeline.context, parse(EMPTY))
    assert planned.inferences == BACKGROUNDS
    assert [(product.needed, product.present) for product in planned.products if product.empty] == [(BACKGROUNDS, 0)]
    assert pipeline.run(second) == "completed"
    assert pipeline.made() == {"prediction": BACKGROUNDS, "evaluation": FRAMES}
    without, beside = (read_table(pipeline.context.engine, read_run(pipeline.context, run)) for run in (first, second))
    assert np.isnan(without.numbers("pacc_empty")).all()
    np.testing.assert_array_equal(without.numbers("pacc"), beside.numbers("pacc"))


def test_a_lost_one_is_made_again_and_what_is_linked_is_kept(pipeline: Pipeline) -> None:
    lost: list[str] = []

    def lose(job: Job) -> None:
        if not lost and job.look is not None and job.look.empty is not None:
            lost.append(job.look.empty)
            pipeline.context.store.delete(product_key("prediction", job.look.empty))

    pipeline.makers[Stage.EVAL].before = lose
    run = pipeline.submit(EMPTY)
    assert pipeline.run(run) == "completed"
    assert pipeline.made()["prediction"] == FRAMES + BACKGROUNDS + 1
    assert {product.verdict for product in replay_frame(pipeline.context, FrameKey(run, 0, 0))} == {"equal"}
    gc.collect(pipeline.context)
    assert pipeline.context.store.exists(product_key("prediction", lost[0]))
    lifecycle.delete(pipeline.context, run)
    gc.collect(pipeline.context)
    assert not pipeline.context.store.exists(product_key("prediction", lost[0]))
