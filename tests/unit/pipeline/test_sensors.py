"""Runs that vary sensors, through the real pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.world.blank import Pipeline, street_pipeline
from tests.world.boxes import spec, write_box_street
from valerie.analysis.summary.summary import summarize
from valerie.db import frames, measured, results
from valerie.db.engine import reading
from valerie.db.measured import SeenPerson
from valerie.errors import InvalidInputs
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.resolving.spec import parse
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS

FRAMES = 4
BENT = {"name": "bent", "distortion": {"k1": -0.9}}


@pytest.fixture(scope="session")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an asset of boxes that declares every parameter of the sensor."""
    folder = tmp_path_factory.mktemp("assets")
    write_box_street(folder / "box-street")
    file = folder / "box-street" / "manifest.yaml"
    document = yaml.safe_load(file.read_text())
    paths = {parameter["path"] for parameter in document["parameters"]}
    definitions = [row.definition().model_dump(mode="json") for row in SENSOR_PARAMETERS.values()]
    document["parameters"] += [definition for definition in definitions if definition["path"] not in paths]
    file.write_text(yaml.safe_dump(document))
    return folder


def small(**more: Any) -> dict[str, Any]:
    return spec(xs=2, ys=2, cameras=["camera-2"], **more)


def table(pipeline: Pipeline, run_id: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = read_table(
        pipeline.context.engine, read_run(pipeline.context, run_id)
    ).arrow.to_pylist()
    return rows


def all_views(pipeline: Pipeline, digest: str) -> list[SeenPerson]:
    with reading(pipeline.context.engine) as connection:
        return measured.person_views(connection, digest)


def test_a_run_with_other_sensors_renders_nothing(pipeline: Pipeline) -> None:
    sensors = [
        {"name": "plain"},
        BENT,
        {"name": "deep", "lens": {"f_number": 1.4, "focus_distance_m": 2}},
        {"name": "noisy", "noise": {"shot": True, "read_electrons": 3, "full_well_electrons": 200}},
        {"name": "drops", "soiling": {"drops": 0.2}},
    ]
    pipeline.run(pipeline.submit(small()))
    assert pipeline.made() == {"background": 1, "layer": 4, "truth": 4, "prediction": 4, "evaluation": 4}
    assert pipeline.run(pipeline.submit(small(sensors=sensors))) == "completed"
    assert pipeline.made() == {"prediction": 4 * FRAMES, "evaluation": 4 * FRAMES}
    # Another seed repeats only the products with random effects.
    assert pipeline.run(pipeline.submit(small(sensors=sensors, seed=1))) == "completed"
    assert pipeline.made() == {"prediction": 2 * FRAMES, "evaluation": 2 * FRAMES}


def test_a_run_that_varies_the_sensor_renders_one_frame_for_all_values(pipeline: Pipeline) -> None:
    vary = {"sensor.noise.read_electrons": {"homogeneous": {"from": 0, "to": 40, "step": 10}}}
    run = pipeline.submit(small(vary=vary, constants={"sensor.noise.shot": True, "sensor.distortion.k1": 0.2}))
    assert pipeline.run(run) == "completed"
    assert pipeline.made() == {"background": 1, "layer": 1, "truth": 1, "prediction": 5, "evaluation": 5}
    assert len(table(pipeline, run)) == 10


def test_visibility_behind_a_distorting_sensor_is_measured_in_the_distorted_image(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[{"name": "plain"}, BENT]))
    assert pipeline.run(run) == "completed"
    rows = [row for row in table(pipeline, run) if row["instance_id"] == 24001]
    plain = [row["pixel_area"] for row in rows if row["sensor"] == "plain"]
    bent = [row["pixel_area"] for row in rows if row["sensor"] == "bent"]
    assert plain == [32 * 18] * FRAMES
    assert all(area > 32 * 18 for area in bent)  # barrel distortion enlarges the visible part
    # tp and fn count the same pixels that visibility counts.
    for row in rows:
        assert row["tp"] + row["fn"] == row["pixel_area"]


def test_distances_and_absent_persons_stay_as_they_are(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[BENT]))
    pipeline.run(run)
    with reading(pipeline.context.engine) as connection:
        frame = frames.get(connection, FrameKey(run, 0, 0))
        (evaluation,) = results.frame_evaluations(connection, FrameKey(run, 0, 0))
    before, after = all_views(pipeline, frame.products.truth), all_views(pipeline, evaluation.scores)
    assert [person.instance_id for person in after] == [person.instance_id for person in before]
    for name in ("distance_m", "depth_m", "undefined_reason"):
        assert [person.measures[name] for person in after] == [person.measures[name] for person in before]


def test_a_sensor_without_distortion_keeps_no_views_of_its_own(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[{"name": "noisy", "noise": {"shot": True}}]))
    pipeline.run(run)
    with reading(pipeline.context.engine) as connection:
        (evaluation,) = results.frame_evaluations(connection, FrameKey(run, 0, 0))
    assert all_views(pipeline, evaluation.scores) == []


def test_noise_is_the_same_in_a_replay_and_in_another_deployment(
    pipeline: Pipeline, tmp_path: Path, assets: Path
) -> None:
    noisy = [{"name": "noisy", "noise": {"shot": True, "full_well_electrons": 200}, "soiling": {"dirt": 0.1}}]
    run = pipeline.submit(small(sensors=noisy))
    pipeline.run(run)
    assert [product.verdict for product in replay_frame(pipeline.context, FrameKey(run, 2, 0))] == ["equal"] * 5
    other = Pipeline(tmp_path / "other", assets)
    again = other.submit(small(sensors=noisy))
    other.run(again)
    strip = ("run_id", "frame_id")
    first, second = ([{k: v for k, v in row.items() if k not in strip} for row in table(*source)]
                     for source in ((pipeline, run), (other, again)))  # fmt: skip
    assert first == second


def test_pictures_for_people_show_truth_aligned_with_the_sensors_image(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[{"name": "plain"}, BENT]))
    pipeline.run(run)

    def painted(kind: str, sensor: str) -> np.ndarray:
        return paint_picture(
            pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0), kind=kind, sensor=sensor)
        )

    for kind in ("picture", "truth", "instances", "depth", "truth-overlay", "errors"):
        assert painted(kind, "plain").shape == painted(kind, "bent").shape
    for kind in ("picture", "truth", "instances"):
        assert (painted(kind, "plain") != painted(kind, "bent")).any()


def test_a_picture_with_defocus_waits_for_the_truth(pipeline: Pipeline) -> None:
    sensors = [{"name": "deep", "lens": {"f_number": 1.4, "focus_distance_m": 2}}]
    run = pipeline.submit(small(sensors=sensors))
    pipeline.step()
    waiting = [row for row in pipeline.products() if row.kind == "prediction"]
    truths = {row.digest for row in pipeline.products() if row.kind == "truth"}
    assert {row.input_c for row in waiting} == truths
    assert pipeline.run(run) == "completed"


def test_a_truth_that_fails_fails_the_picture_that_needs_its_depth(pipeline: Pipeline) -> None:
    from valerie.errors import RenderingError

    def break_truth(job: Any) -> None:
        if job.kind == "truth":
            raise RenderingError("no truth today")

    pipeline.makers["render"].before = break_truth
    run = pipeline.submit(small(sensors=[{"name": "deep", "lens": {"f_number": 1.4}}]))
    assert pipeline.run(run) == "completed-with-failures"
    assert {row.state for row in pipeline.products() if row.kind == "prediction"} == {"failed"}


def test_deleting_a_run_frees_the_views_of_its_sensors(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[BENT]))
    pipeline.run(run)
    with reading(pipeline.context.engine) as connection:
        (evaluation,) = results.frame_evaluations(connection, FrameKey(run, 0, 0))
    lifecycle.delete(pipeline.context, run)
    gc.collect(pipeline.context)
    assert all_views(pipeline, evaluation.scores) == []


MOVING = {
    "vary": [["person-1.trajectory.start", "CONSTANT", 0]],
    "trajectories": {
        "person-1": [[0, -1, 4], ["10 ms", 1, 4]]
    },  # 200 m/s: 200 pixels per second in the blank engine's picture
    "sequence": [2, "4 ms"],
}


def test_a_shutter_requests_velocities_once_and_no_other_renders(pipeline: Pipeline) -> None:
    open_for = [{"name": name, "shutter": {"exposure_ms": ms}} for name, ms in (("short", 2), ("long", 30))]
    assert pipeline.run(pipeline.submit(small(**{**MOVING, "sensors": open_for[:1]}))) == "completed"
    assert pipeline.made() == {"background": 1, "layer": 2, "truth": 2, "velocity": 2, "prediction": 2, "evaluation": 2}
    run = pipeline.submit(small(**{**MOVING, "sensors": [{"name": "plain"}, *open_for]}))
    assert pipeline.run(run) == "completed"
    assert pipeline.made() == {"prediction": 4, "evaluation": 4}
    assert all(product.agrees for product in replay_frame(pipeline.context, FrameKey(run, 0, 0, 1)))
    plain, short, long = (
        paint_picture(
            pipeline.context, find_picture(pipeline.context, FrameKey(run, 0, 0, 0), kind="picture", sensor=name)
        )
        for name in ("plain", "short", "long")
    )
    # The edges of the square, columns 16 and 48, move by 0.4 and by 6 pixels while the shutter is open.
    changed = [np.flatnonzero((plain != blurred).any(axis=(0, 2))) for blurred in (short, long)]
    assert set(changed[0].tolist()) <= set(range(15, 18)) | set(range(46, 50))
    assert changed[1].size > 6
    assert set(changed[1].tolist()) <= set(range(12, 20)) | set(range(44, 52))


def test_labels_lean_with_the_image_of_a_rolling_shutter(pipeline: Pipeline) -> None:
    # The square of the blank engine stands a pixel further right for each metre that the person is.
    rolling = {"name": "rolling", "shutter": {"line_time_us": 1000}}
    run = pipeline.submit(small(**{**MOVING, "sensors": [rolling, {"name": "plain"}]}))
    assert pipeline.run(run) == "completed"
    assert pipeline.made() == {"background": 1, "layer": 2, "truth": 2, "scan": 2, "prediction": 4, "evaluation": 4}
    source = find_picture(pipeline.context, FrameKey(run, 0, 0, 0), kind="truth", sensor="rolling")
    truth = source.capture.seen_truth(ProductReader(pipeline.context.store))
    firsts = [int(np.flatnonzero(row == 24001)[0]) for row in truth.instance_map[9:27]]
    # Each row is that of its own moment: the person has moved from −1 m to 1 m within 10 rows.
    assert firsts == [16 + round(float(np.clip(-1 + 0.2 * (row - 17.5), -1, 1))) for row in range(9, 27)]
    rows = [row for row in table(pipeline, run) if row["instance_id"] == 24001]
    assert all(row["tp"] + row["fn"] == row["pixel_area"] for row in rows)
    assert all(product.agrees for product in replay_frame(pipeline.context, FrameKey(run, 0, 0, 1)))


def test_frames_that_differ_only_in_people_share_a_metered_exposure(pipeline: Pipeline) -> None:
    run = pipeline.submit(small(sensors=[{"name": "metered", "auto_exposure": True}]))
    assert pipeline.run(run) == "completed"
    pictures = [
        paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run, variant, 0), kind="picture"))
        for variant in (0, 1)
    ]
    outside = np.ones(pictures[0].shape[:2], np.bool_)
    outside[9:27, 16:48] = False  # the square of the blank engine, which differs
    assert (pictures[0] != pictures[1]).any()
    np.testing.assert_array_equal(pictures[0][outside], pictures[1][outside])


def test_rolling_shutters_of_one_run_agree(pipeline: Pipeline) -> None:
    sensors = [{"name": str(time), "shutter": {"line_time_us": time}} for time in (0, 10, 20)]
    warnings = plan_run(pipeline.context, parse(small(**{**MOVING, "sensors": sensors[:2]}))).warnings
    assert any("sensor 10: a rolling shutter renders each frame in slices" in text for text in warnings)
    with pytest.raises(InvalidInputs, match="differ in line time or distortion"):
        plan_run(pipeline.context, parse(small(**{**MOVING, "sensors": sensors})))


def test_a_shutter_in_a_run_without_time_changes_nothing_and_says_so(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit(small()))
    pipeline.made()
    still = small(sensors=[{"name": "slow", "shutter": {"exposure_ms": 100, "line_time_us": 20}}])
    warnings = plan_run(pipeline.context, parse(still)).warnings
    assert any("motion blur changes nothing" in text for text in warnings)
    pipeline.run(pipeline.submit(still))
    assert pipeline.made() == {}


def test_the_grey_levels_of_each_picture_are_kept_behind_its_own_sensor(tmp_path: Path) -> None:
    pipeline = street_pipeline(tmp_path)
    dark = {"name": "dark", "exposure_ev": -16}
    run = pipeline.submit(spec(xs=2, ys=1, sensors=[{"name": "day"}, dark]))
    assert pipeline.run(run) == "completed"
    stored = read_run(pipeline.context, run)
    table = read_table(pipeline.context.engine, stored)
    means = {name: table.numbers("picture_mean")[table.codes("sensor").where(name)] for name in ("day", "dark")}
    assert means["day"].min() > 50
    assert means["dark"].max() < 2
    (warning,) = [text for text in summarize(table).warnings if "black" in text]
    assert warning.startswith("4 of 8 pictures are black (frames ")
