"""Annotations through the whole pipeline, on the blank engine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.datasets import coco
from valerie.db import frames, results
from valerie.db.claiming import Job
from valerie.db.engine import reading
from valerie.errors import Conflict, RenderingError, UnknownName
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.export.datasets import export_run
from valerie.pipeline.export.export_plan import ExportSettings
from valerie.pipeline.reading.annotation_files import key_points
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.rendering.annotations.joints import HIDDEN, LIMBS, OUTSIDE, SELF_HIDDEN, VISIBLE, Joints
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.states import Stage
from valerie.runs.resolving.spec import parse
from valerie.scene.graph.model import JOINTS

FRAMES = 8
ASKED = spec(xs=2, ys=2, annotations=["normals", "boxes"])
ALL = {"background": 2, "layer": FRAMES, "truth": FRAMES, "prediction": FRAMES, "evaluation": FRAMES}


def test_a_run_that_asks_gets_one_product_per_frame_and_kind(pipeline: Pipeline) -> None:
    run = pipeline.submit(ASKED)
    assert pipeline.run(run) == "completed"
    assert pipeline.made() == {**ALL, "normals": FRAMES, "boxes": FRAMES}
    progress = pipeline.row(run).progress
    assert progress is not None
    stage = progress.stages[Stage.RENDER]
    assert (stage.done, stage.total, stage.failed, stage.running, stage.eta_s) == (FRAMES, FRAMES, 0, 0, 0.0)


def test_asking_afterwards_makes_the_annotations_and_nothing_else(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit(spec(xs=2, ys=2)))
    assert pipeline.made() == ALL
    before = plan_run(pipeline.context, parse(ASKED))
    assert (before.renders, before.inferences) == (2 * FRAMES, 0)
    pipeline.run(pipeline.submit(ASKED))
    assert pipeline.made() == {"normals": FRAMES, "boxes": FRAMES}


def test_another_sun_keeps_them(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit(ASKED))
    pipeline.made()
    pipeline.run(pipeline.submit({**ASKED, "constants": {"sun-1.azimuth": 77.0}}))
    assert not {"normals", "boxes", "truth"} & pipeline.made().keys()


def test_they_are_replayed_byte_for_byte(pipeline: Pipeline) -> None:
    run = pipeline.submit(ASKED)
    pipeline.run(run)
    replayed = {product.kind: product.verdict for product in replay_frame(pipeline.context, FrameKey(run, 0, 1))}
    assert replayed["normals"] == replayed["boxes"] == "equal"
    assert set(replayed.values()) == {"equal"}


def test_they_are_read_back_and_shown(pipeline: Pipeline) -> None:
    run = pipeline.submit(ASKED)
    pipeline.run(run)
    with reading(pipeline.context.engine) as connection:
        links = frames.annotation_links(connection, FrameKey(run, 0, 0))
    reader = ProductReader(pipeline.context.store)
    assert reader.normals(links["normals"].product).octahedral.shape == (36, 64, 2)
    boxes = reader.boxes(links["boxes"].product)
    assert boxes.pixel_areas[boxes.instances.tolist().index(24001)] == 16 * 36  # the blank truth's square
    normals = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind="normals"))
    assert np.unique(normals.reshape(-1, 3), axis=0).tolist() == [[128, 128, 255]]
    drawn = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind="boxes"))
    picture = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind="picture"))
    assert 0 < (drawn != picture).any(axis=2).sum() < picture[..., 0].size


def test_joints_are_made_also_where_nobody_has_a_skeleton(pipeline: Pipeline) -> None:
    run = pipeline.submit(spec(xs=2, ys=2, annotations=["joints"]))
    assert pipeline.run(run) == "completed"
    with reading(pipeline.context.engine) as connection:
        link = frames.annotation_links(connection, FrameKey(run, 0, 0))["joints"]
    assert ProductReader(pipeline.context.store).joints(link.product).known.tolist() == [0]
    drawn = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind="joints"))
    picture = paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind="picture"))
    assert np.array_equal(drawn, picture)


def test_an_export_takes_their_arrays_along(pipeline: Pipeline, tmp_path: Path) -> None:
    run = pipeline.submit(spec(xs=2, ys=2, annotations=["normals", "boxes", "joints", "light"]))
    pipeline.run(run)
    export_run(pipeline.context, run, tmp_path / "set", ExportSettings(formats=("coco", "parquet")))
    files = sorted(path.name for path in (tmp_path / "set/annotations/val/boxes-camera-1").iterdir())
    kinds = ("boxes", "joints", "light", "normals")
    assert files[:4] == [f"boxes-camera-1_000000_000000_{kind}.npz" for kind in kinds]
    assert len(files) == 4 * FRAMES // 2
    with np.load(tmp_path / "set/annotations/val/boxes-camera-1" / files[0]) as stored:
        assert stored["instances"].tolist() == [24001, 26001]
    with np.load(tmp_path / "set/annotations/val/boxes-camera-1" / files[2]) as stored:
        assert (stored["instances"].tolist(), stored["irradiance"].tolist()) == ([24001], [0.5])
    rows = pq.read_table(tmp_path / "set/index.parquet").to_pylist()
    assert {row["irradiance"] for row in rows if row["pixel_area"]} == {0.5}
    document = json.loads((tmp_path / "set/coco/instances_val.json").read_text())
    assert not any("keypoints" in annotation for annotation in document["annotations"])  # nobody has a skeleton
    assert not any("keypoints" in category for category in document["categories"])


def test_an_export_takes_only_the_annotations_that_are_named(pipeline: Pipeline, tmp_path: Path) -> None:
    run = pipeline.submit(ASKED)
    pipeline.run(run)
    export_run(pipeline.context, run, tmp_path / "some", ExportSettings(annotations=("boxes",)))
    assert {path.name.rpartition("_")[2] for path in tmp_path.glob("some/annotations/val/*/*")} == {"boxes.npz"}
    assert json.loads((tmp_path / "some/dataset.json").read_text())["annotations"] == ["boxes"]
    export_run(pipeline.context, run, tmp_path / "bare", ExportSettings(annotations=()))
    assert not (tmp_path / "bare/annotations").exists()
    with pytest.raises(UnknownName, match="unknown annotation of the run 'box'; did you mean boxes"):
        export_run(pipeline.context, run, tmp_path / "none", ExportSettings(annotations=("box",)))


def test_an_export_says_which_annotation_failed_and_what_helps(pipeline: Pipeline, tmp_path: Path) -> None:
    def refuse(job: object) -> None:
        if job.kind == "boxes":  # type: ignore[attr-defined]
            raise RenderingError("no boxes today")

    pipeline.makers["render"].before = refuse
    run = pipeline.submit(ASKED)
    pipeline.run(run)
    with pytest.raises(Conflict, match=f"boxes failed for good; `valerie retry {run}` tries again"):
        export_run(pipeline.context, run, tmp_path / "set", ExportSettings())


def test_joints_become_key_points_with_cocos_flags() -> None:
    count = len(JOINTS)
    flags = np.zeros((1, count), np.uint8)
    flags[0, :4] = OUTSIDE, HIDDEN, SELF_HIDDEN, VISIBLE
    pixels = np.full((1, count, 2), (12.345, 6.0), np.float32)
    pixels[0, 0] = np.nan
    empty = np.zeros((1, count, 3), np.float32)
    joints = Joints(np.array([24001]), np.array([1], np.uint8), empty, empty, pixels, flags)
    (person,) = key_points(joints).values()
    assert [person["keypoints"][2 + 3 * k] for k in range(5)] == [0, 1, 1, 2, 0]
    assert person["keypoints"][:3] == [0.0, 0.0, 0]
    assert person["keypoints"][9:12] == pytest.approx([12.345, 6.0, 2], abs=0.0051)
    assert person["num_keypoints"] == 3
    document = coco.assemble([], [person], "one", key_points=JOINTS, limbs=LIMBS)
    category, other = [category for category in document["categories"] if "keypoints" in category]
    assert {category["name"], other["name"]} == {"person", "rider"}
    assert len(category["keypoints"]) == len(other["keypoints"]) == count
    assert min(min(limb) for limb in category["skeleton"]) >= 1
    assert max(max(limb) for limb in category["skeleton"]) <= count


def test_a_run_that_did_not_ask_has_no_such_picture(pipeline: Pipeline) -> None:
    run = pipeline.submit()
    pipeline.run(run)
    with pytest.raises(UnknownName, match="normals"):
        find_picture(pipeline.context, FrameKey(run, 0, 0), kind="normals")


def test_a_picture_of_what_is_not_made_yet_is_a_conflict(pipeline: Pipeline) -> None:
    run = pipeline.submit(ASKED)
    pipeline.step()
    with pytest.raises(Conflict, match="not available yet"):
        find_picture(pipeline.context, FrameKey(run, 0, 0), kind="normals")


def test_a_failed_annotation_is_a_recorded_failure_of_its_frame_alone(pipeline: Pipeline) -> None:
    def refuse(job: Job) -> None:
        if job.kind == "boxes" and (job.frame.key.variant, job.frame.key.camera) == (0, 0):
            raise RenderingError("no boxes today")

    pipeline.makers["render"].before = refuse
    run = pipeline.submit(ASKED)
    assert pipeline.run(run) == "completed-with-failures"
    progress = pipeline.row(run).progress
    assert progress is not None
    assert (progress.stages[Stage.RENDER].done, progress.stages[Stage.RENDER].failed) == (FRAMES - 1, 1)
    assert progress.stages[Stage.EVAL].done == FRAMES
    with reading(pipeline.context.engine) as connection:
        (failure,) = results.failures(connection, run)
    assert (failure.kind, failure.frame.variant) == ("boxes", 0)
    pipeline.makers["render"].before = lambda _: None
    lifecycle.retry(pipeline.context, run)
    assert pipeline.run(run) == "completed"


class TestLight:
    LIT = spec(xs=2, ys=2, annotations=["light"])

    def test_its_columns_come_with_the_run_that_asks(self, pipeline: Pipeline) -> None:
        run = pipeline.submit(self.LIT)
        assert pipeline.run(run) == "completed"
        assert pipeline.made() == {**ALL, "light": FRAMES}
        table = table_of(pipeline, run)
        here = table["instance_id"].to_numpy() == 24001
        assert set(table["irradiance"].to_numpy()[here]) == {0.5}  # a quarter of sun and a quarter of the rest
        assert set(table["shadow_share"].to_numpy()[here]) == {0.0}
        contrast = table["contrast"].to_numpy()[here]
        assert len(set(contrast)) > 1
        assert (np.abs(contrast) < 1).all()

    def test_without_it_they_are_empty(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        pipeline.run(run)
        table = table_of(pipeline, run)
        for name in ("irradiance", "shadow_share", "contrast"):
            assert table[name].null_count == len(table)
        assert (
            table["bearing_deg"].null_count == table["aspect_deg"].null_count == len(table) // 2
        )  # person 2 is absent

    def test_a_run_of_other_sensors_measures_nothing_again(self, pipeline: Pipeline) -> None:
        pipeline.run(pipeline.submit(self.LIT))
        pipeline.made()
        pipeline.run(pipeline.submit({**self.LIT, "sensors": [{"name": "dark", "exposure_ev": -2.0}]}))
        assert pipeline.made() == {"prediction": FRAMES, "evaluation": FRAMES}

    def test_another_sun_measures_it_again_on_the_same_truth(self, pipeline: Pipeline) -> None:
        pipeline.run(pipeline.submit(self.LIT))
        pipeline.made()
        pipeline.run(pipeline.submit({**self.LIT, "constants": {"sun-1.azimuth": 77.0}}))
        products = pipeline.made()
        assert products["light"] == FRAMES
        assert "truth" not in products

    def test_it_is_replayed_and_freed_like_the_rest(self, pipeline: Pipeline) -> None:
        run = pipeline.submit(self.LIT)
        pipeline.run(run)
        replayed = {product.kind: product.verdict for product in replay_frame(pipeline.context, FrameKey(run, 0, 1))}
        assert replayed["light"] == "equal"
        everything = len(pipeline.products())
        lifecycle.delete(pipeline.context, run)
        assert gc.collect(pipeline.context).products == everything


def table_of(pipeline: Pipeline, run: str) -> Any:
    return read_table(pipeline.context.engine, read_run(pipeline.context, run)).arrow


def test_what_nobody_links_any_more_is_freed(pipeline: Pipeline) -> None:
    run = pipeline.submit(ASKED)
    pipeline.run(run)
    assert gc.collect(pipeline.context).products == 0
    everything = len(pipeline.products())
    assert everything >= sum(ALL.values()) + 2 * FRAMES
    lifecycle.delete(pipeline.context, run)
    assert gc.collect(pipeline.context).products == everything
    assert not pipeline.products()
