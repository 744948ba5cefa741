"""Sequences through the real pipeline: rows, products, tables, replay and export of frames that follow each other."""

from __future__ import annotations

from typing import Any

import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import frames
from valerie.db.engine import reading
from valerie.errors import InvalidInputs
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.selection import choose_frames, run_where
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import Stage


def moving(**more: Any) -> dict[str, Any]:
    """One variant, one camera, five moments; the person stands from 1 s on."""
    document = spec(xs=1, ys=1, cameras=["camera-2"], sequence=[5, "500 ms"], **more)
    document["vary"] = {"person-1.trajectory.key-2.pos.x": {"choice": [1.0]}}
    document["trajectories"] = {"person-1": [[0, -1, 4], [1, 1, 4]]}
    return document


def test_each_moment_is_a_frame_and_equal_moments_share_their_products(pipeline: Pipeline) -> None:
    run_id = pipeline.submit(moving())
    assert pipeline.run(run_id) == "completed"
    # At 1 s, 1.5 s and 2 s the person stands at the same place.
    assert pipeline.made() == {"background": 1, "layer": 3, "truth": 3, "prediction": 3, "evaluation": 3}
    rows = read_table(pipeline.context.engine, read_run(pipeline.context, run_id)).arrow.to_pylist()
    assert [(row["frame_id"].rpartition(".")[2], row["time_s"]) for row in rows if row["instance_id"] == 24001] == [
        ("0", 0.0), ("1", 0.5), ("2", 1.0), ("3", 1.5), ("4", 2.0),
    ]  # fmt: skip
    assert len({row["distance_m"] for row in rows if row["instance_id"] == 24001}) == 3
    progress = pipeline.row(run_id).progress
    assert progress is not None
    assert progress.stages[Stage.RENDER].done == 5


def test_every_frame_of_a_sequence_can_be_made_again(pipeline: Pipeline) -> None:
    run_id = pipeline.submit(moving())
    pipeline.run(run_id)
    digests = set()
    for index in range(5):
        replayed = replay_frame(pipeline.context, FrameKey(run_id, 0, 0, index))
        assert all(product.agrees for product in replayed), replayed
        digests.add(next(product.digest for product in replayed if product.kind == "truth"))
    assert len(digests) == 3


def test_frames_are_chosen_by_time_and_by_where_things_are_then(pipeline: Pipeline) -> None:
    run_id = pipeline.submit(moving())
    pipeline.run(run_id)
    run = read_run(pipeline.context, run_id)
    with reading(pipeline.context.engine) as connection:

        def chosen(text: str) -> list[int]:
            where = run_where(text, run.resolved)
            return [frame.key.time for frame in choose_frames(connection, run, where=where)]

        assert chosen("time_s > 0.7") == [2, 3, 4]
        assert chosen("person-1.pos.x < 0.5") == [0, 1]
        assert chosen("pacc >= 0 and time_s <= 0.5") == [0, 1]
        chosen = choose_frames(connection, run)
    assert [frame.moment["scene.person-1.pos.x"] for frame in chosen] == pytest.approx([-1, 0, 1, 1, 1])
    assert {frame.moment["scene.person-1.heading"] for frame in chosen} == {270.0}


def test_a_variant_that_is_illegal_at_one_moment_has_no_frames(pipeline: Pipeline) -> None:
    document = moving()
    document["vary"] = {"person-1.trajectory.key-2.pos.y": {"choice": [4.0, 8.0]}}  # at 8 m a car stands
    document["trajectories"] = {"person-1": [[0, -1, 4], [1, 2, 4], [2, -1, 4]]}
    run_id = pipeline.submit(document)
    assert pipeline.run(run_id) == "completed"
    with reading(pipeline.context.engine) as connection:
        keys = [frame.key for frame, _ in frames.page(connection, run_id, limit=100)]
    assert keys == [FrameKey(run_id, 0, 0, time) for time in range(5)]


def test_flow_leads_to_the_next_frame_and_velocity_is_per_second(pipeline: Pipeline) -> None:
    run_id = pipeline.submit(moving(annotations=["flow", "velocity"], functions=[]))
    assert pipeline.run(run_id) == "completed"
    # From 1 s on nothing moves: the flow of the last three moments is one product, and so is their velocity.
    assert pipeline.made() == {"background": 1, "layer": 3, "truth": 3, "flow": 3, "velocity": 3}
    reader = ProductReader(pipeline.context.store)
    steps, speeds = [], []
    with reading(pipeline.context.engine) as connection:
        for index in range(5):
            links = frames.annotation_links(connection, FrameKey(run_id, 0, 0, index))
            steps.append(float(reader.flow(links["flow"].product).vectors[18, 32, 0]))
            speeds.append(float(reader.velocity(links["velocity"].product).vectors[18, 32, 0]))
    # The blank engine's square moves a pixel for each metre: 2 m in 1 s.
    assert steps == pytest.approx([1, 1, 0, 0, 0], abs=1e-5)
    assert speeds == pytest.approx([2, 2, 0, 0, 0], abs=1e-3)
    painted = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run_id, 0, 0, 0), kind="flow"))
    assert [painted[18, 32].tolist(), painted[0, 0].tolist()] == [[255, 0, 0], [255, 255, 255]]
    assert all(product.agrees for product in replay_frame(pipeline.context, FrameKey(run_id, 0, 0, 4)))


def test_what_flow_needs_is_asked_for(pipeline: Pipeline) -> None:
    still = spec(xs=1, ys=1)
    with pytest.raises(InvalidInputs, match="flow leads to the next frame of a sequence"):
        pipeline.submit({**still, "annotations": ["flow"]})
    with pytest.raises(InvalidInputs, match="nothing moves in this run"):
        pipeline.submit({**still, "annotations": ["velocity"]})
