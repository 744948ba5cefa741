from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy import delete, select

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import spec
from valerie.db import frames, results, runs, sweeping, totals
from valerie.db.engine import reading, writing
from valerie.db.models import FedBlock, Product, Worker
from valerie.errors import (
    Conflict,
    InvalidInput,
    NotFound,
    RenderingError,
    StorageFull,
    StorageUnavailable,
    TransientError,
)
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.pipeline.base.resolved_runs import read_run
from valerie.pipeline.control import feeding, gc, lifecycle
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.reading.tables import read_table
from valerie.pipeline.work.replay import replay_frame
from valerie.runs.products.frame_keys import FrameKey
from valerie.runs.products.ready import FailedInput, Fault
from valerie.runs.products.states import ProductKind, Stage
from valerie.runs.resolving.spec import parse
from valerie.storage import codecs
from valerie.storage.envelope import intact
from valerie.storage.keys import PRODUCTS, RUNS, product_key, run_prefix

FRAMES = 24
ALL = {"background": 2, "layer": FRAMES, "truth": FRAMES, "prediction": FRAMES, "evaluation": FRAMES}


def rows(pipeline: Pipeline, run_id: str) -> list[dict[str, Any]]:
    table = read_table(pipeline.context.engine, read_run(pipeline.context, run_id)).arrow.to_pylist()
    return [{k: v for k, v in row.items() if k not in ("run_id", "frame_id")} for row in table]


def blocks(pipeline: Pipeline, run_id: str) -> list[tuple[int, int, int]]:
    """Return number, first and last variant of each block."""
    columns = (FedBlock.number, FedBlock.first, FedBlock.last)
    with reading(pipeline.context.engine) as connection:
        rows = connection.execute(select(*columns).where(FedBlock.run_id == run_id).order_by(FedBlock.number))
        return [(row[0], row[1], row[2]) for row in rows]


class TestAnUndisturbedRun:
    def test_makes_every_product_once_and_ends_with_results(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        assert pipeline.run(run) == "completed"
        assert pipeline.made() == ALL
        assert len(rows(pipeline, run)) == 2 * FRAMES
        names = {info.key.rpartition("/")[2] for info in pipeline.context.store.list(run_prefix(run))}
        assert names == {"environment.json", "report.html", "summary.json", "evaluations.csv", "evaluations.parquet"}
        progress = pipeline.row(run).progress
        assert progress is not None
        assert {stage: done.done for stage, done in progress.stages.items()} == dict.fromkeys(Stage, FRAMES)

    def test_a_small_window_feeds_a_run_piece_by_piece(
        self, pipelines: Callable[..., Pipeline], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        pipeline = pipelines(feed_window=1)
        monkeypatch.setattr(feeding, "BLOCK_PRODUCTS", 40)  # two backgrounds, and eight products per variant
        run = pipeline.submit()
        pipeline.step()
        assert pipeline.row(run).next_index == 5
        # As after an upgrade: blocks of another size begin where the last one ended.
        monkeypatch.setattr(feeding, "BLOCK_VARIANTS", 2)
        assert pipeline.run(run) == "completed"
        assert blocks(pipeline, run) == [(0, 0, 4), (1, 5, 6), (2, 7, 8), (3, 9, 10), (4, 11, 11)]
        assert pipeline.made() == ALL

    def test_a_replayed_frame_is_equal_byte_for_byte(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        pipeline.run(run)
        assert [product.verdict for product in replay_frame(pipeline.context, FrameKey(run, 0, 1))] == ["equal"] * 5

    def test_a_truth_that_was_stored_whole_is_read_and_replayed(self, pipeline: Pipeline) -> None:
        run = pipeline.submit(spec(xs=2, ys=1))
        pipeline.run(run)
        with reading(pipeline.context.engine) as connection:
            truth = frames.get(connection, FrameKey(run, 0, 0, 0)).products.truth
        whole = ProductReader(pipeline.context.store).truth(truth)
        pipeline.context.store.put(product_key("truth", truth), codecs.encode_truth(whole), replace=True)
        read = ProductReader(pipeline.context.store).truth(truth)
        assert codecs.encode_truth(read) == codecs.encode_truth(whole)
        assert replay_frame(pipeline.context, FrameKey(run, 0, 0))[2].verdict == "equal"


class TestReuse:
    def test_the_same_spec_again_makes_nothing(self, pipeline: Pipeline) -> None:
        first = pipeline.submit()
        pipeline.run(first)
        pipeline.made()
        second = pipeline.submit()
        assert pipeline.run(second) == "completed"
        assert pipeline.made() == {}
        assert rows(pipeline, first) == rows(pipeline, second)

    def test_another_sensor_renders_nothing(self, pipeline: Pipeline) -> None:
        pipeline.run(pipeline.submit())
        pipeline.made()
        pipeline.run(pipeline.submit(spec(xs=4, ys=3, sensors=[{"name": "dark", "exposure_ev": -2.0}])))
        assert pipeline.made() == {"prediction": FRAMES, "evaluation": FRAMES}

    def test_another_sun_keeps_the_truth(self, pipeline: Pipeline) -> None:
        pipeline.run(pipeline.submit())
        pipeline.made()
        pipeline.run(pipeline.submit(spec(xs=4, ys=3, constants={"sun-1.azimuth": 77.0})))
        assert "truth" not in pipeline.made()

    def test_two_runs_wait_for_the_same_products(self, pipeline: Pipeline) -> None:
        first, second = pipeline.submit(), pipeline.submit()
        pipeline.run(first)
        assert pipeline.run(second) == "completed"
        assert pipeline.made() == ALL

    def test_a_plan_knows_what_is_there(self, pipeline: Pipeline) -> None:
        before = plan_run(pipeline.context, parse(SMALL))
        pipeline.run(pipeline.submit())
        after = plan_run(pipeline.context, parse(SMALL))
        assert (before.renders, before.inferences) == (2 + 2 * FRAMES, FRAMES)
        assert (after.renders, after.inferences, after.cpu_seconds) == (0, 0, 0.0)


class TestFailures:
    def test_what_fails_for_good_is_recorded_and_the_rest_completes(self, pipeline: Pipeline) -> None:
        broken: list[str] = []

        def refuse_first_layer(job: Any) -> None:
            if job.kind == "layer" and (not broken or job.digest in broken):
                broken[:] = [job.digest]
                raise RenderingError("the image is constant")

        pipeline.makers["render"].before = refuse_first_layer
        run = pipeline.submit()
        assert pipeline.run(run) == "completed-with-failures"
        assert len(rows(pipeline, run)) == 2 * (FRAMES - 1)
        with reading(pipeline.context.engine) as connection:
            failures = {link.kind: link.error for link in results.failures(connection, run)}
        layer, prediction, evaluation = ProductKind.LAYER, ProductKind.PREDICTION, ProductKind.EVALUATION
        fault = Fault(stage=layer, type="RenderingError", message="the image is constant", attempts=1)
        assert failures[layer] == fault
        assert failures[prediction] == FailedInput(cause=broken[0])
        assert set(failures) == {layer, prediction, evaluation}

        pipeline.makers["render"].before = lambda _job: None
        lifecycle.retry(pipeline.context, run)
        assert pipeline.run(run) == "completed"
        assert len(rows(pipeline, run)) == 2 * FRAMES

    def test_a_transient_fault_is_tried_again_up_to_the_limit(self, pipeline: Pipeline) -> None:
        attempts: dict[str, int] = {}

        def stumble(job: Any) -> None:
            attempts[job.digest] = attempts.get(job.digest, 0) + 1
            if job.kind == "prediction" and attempts[job.digest] < 2:
                raise TransientError("try again")

        pipeline.makers["infer"].before = stumble
        assert pipeline.run(pipeline.submit()) == "completed"
        predictions = [product for product in pipeline.products() if product.kind == "prediction"]
        assert {product.attempts for product in predictions} == {2}

    def test_a_defect_of_an_engine_is_a_recorded_failure(self, pipeline: Pipeline) -> None:
        def crash(_job: Any) -> None:
            raise ZeroDivisionError("oops")

        pipeline.makers["eval"].before = crash
        run = pipeline.submit()
        assert pipeline.run(run) == "completed-with-failures"
        with reading(pipeline.context.engine) as connection:
            errors = {link.error.type for link in results.failures(connection, run) if isinstance(link.error, Fault)}
        assert errors == {"ZeroDivisionError"}

    def test_a_lost_object_is_made_again(self, pipeline: Pipeline) -> None:
        lost: list[str] = []

        def lose_a_layer(job: Any) -> None:
            if not lost:
                layer = job.frame.products.layer
                lost.append(layer)
                pipeline.context.store.delete(product_key("layer", layer))

        pipeline.makers["infer"].before = lose_a_layer
        assert pipeline.run(pipeline.submit()) == "completed"
        assert pipeline.made() == {**ALL, "layer": FRAMES + 1}

    def test_a_product_freed_while_it_is_made_costs_no_other_product(self, pipeline: Pipeline) -> None:
        freed: list[str] = []

        def free_first_truth(job: Any) -> None:
            if job.kind == "truth" and not freed:
                freed.append(job.digest)
                with writing(pipeline.context.engine) as connection:
                    sweeping.free(connection, freed)

        pipeline.makers["render"].before = free_first_truth
        pipeline.submit()
        pipeline.step()
        done = [product for product in pipeline.products() if product.state == "done"]
        assert (
            len([product for product in done if product.kind in ("background", "layer", "truth")]) == 2 + 2 * FRAMES - 1
        )
        assert freed[0] not in {product.digest for product in done}

    @pytest.mark.parametrize("damage", ["lost", "broken"])
    def test_the_statics_of_a_truth_are_stored_again(self, pipeline: Pipeline, damage: str) -> None:
        run = pipeline.submit(spec(xs=2, ys=1))
        keys: list[str] = []

        def harm(job: Any) -> None:
            if not keys and job.kind == "evaluation":
                keys.extend(info.key for info in pipeline.context.store.list(f"{PRODUCTS}statics"))
                pipeline.context.store.delete(keys)
                if damage == "broken":
                    pipeline.context.store.put(keys[0], b"nothing of it", replace=True)

        pipeline.makers["eval"].before = harm
        assert pipeline.run(run) == "completed"
        assert len(keys) == 1
        assert intact(pipeline.context.store.get(keys[0]))

    def test_a_damaged_object_is_made_again(self, pipeline: Pipeline) -> None:
        spoilt: list[str] = []

        def spoil_a_truth(job: Any) -> None:
            if not spoilt:
                truth = job.frame.products.truth
                spoilt.append(truth)
                pipeline.context.store.put(product_key("truth", truth), b"not a truth", replace=True)

        pipeline.makers["eval"].before = spoil_a_truth
        assert pipeline.run(pipeline.submit()) == "completed"
        assert pipeline.made() == {**ALL, "truth": FRAMES + 1}


class TestStorage:
    def test_a_full_disk_pauses_the_run_with_the_reason_and_it_resumes(self, pipeline: Pipeline) -> None:
        full = [True]

        def refuse(_job: Any) -> None:
            if full[0]:
                raise StorageFull("no space left on the device")

        pipeline.makers["infer"].before = refuse
        store_check = type(pipeline.context.store).check

        def check(store: Any) -> None:
            if full[0]:
                raise StorageFull("no space left on the device")
            store_check(store)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(pipeline.context.store), "check", check)
            run = pipeline.submit()
            assert pipeline.run(run, until=["paused"]) == "paused"
            assert pipeline.row(run).reason == "storage: no space left on the device"
            pipeline.step()
            assert pipeline.state(run) == "paused"
            full[0] = False
            assert pipeline.run(run) == "completed"
        assert {product.attempts for product in pipeline.products()} == {1}

    def test_a_count_that_began_before_a_pause_leaves_its_reason(
        self, pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        backlog, pauses = totals.backlog, [StorageFull("no space left on the device")]

        def pause_while_it_counts(connection: Any) -> Any:
            while pauses:
                pause_for_storage(pipeline.context, pauses.pop())
            return backlog(connection)

        monkeypatch.setattr(totals, "backlog", pause_while_it_counts)
        run = pipeline.submit()
        assert pipeline.run(run, until=["paused"]) == "paused"
        assert pipeline.row(run).reason == "storage: no space left on the device"
        assert pipeline.run(run) == "completed"

    @pytest.mark.parametrize(
        "error",
        [
            StorageFull("no space left on the device"),
            StorageUnavailable("read-only file system"),
            OSError(errno.ENOSPC, "No space left on device", "/tmp/x"),
        ],
        ids=lambda error: type(error).__name__,
    )
    def test_a_full_or_read_only_disk_pauses_a_run_that_ends(
        self, pipeline: Pipeline, error: Exception, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store, full = type(pipeline.context.store), [True]
        put, check = store.put, store.check

        def refuse(self: Any, key: str, *arguments: Any, **keywords: Any) -> bool:
            if full[0] and key.startswith(RUNS):
                raise error
            return put(self, key, *arguments, **keywords)

        def look(self: Any) -> None:
            if full[0]:
                raise StorageFull("no space left on the device")
            check(self)

        monkeypatch.setattr(store, "put", refuse)
        monkeypatch.setattr(store, "check", look)
        run = pipeline.submit(spec(xs=2, ys=1))
        assert pipeline.run(run, until=["paused"]) == "paused"
        assert pipeline.row(run).reason.startswith("storage: ")
        pipeline.step()
        assert pipeline.state(run) == "paused"
        full[0] = False
        assert pipeline.run(run) == "completed"

    def test_a_transient_fault_while_a_run_ends_is_tried_again(
        self, pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        store, faults = type(pipeline.context.store), [2]
        put = store.put

        def stumble(self: Any, key: str, *arguments: Any, **keywords: Any) -> bool:
            if key.startswith(RUNS) and faults[0]:
                faults[0] -= 1
                raise TransientError("the database did not answer")
            return put(self, key, *arguments, **keywords)

        monkeypatch.setattr(store, "put", stumble)
        assert pipeline.run(pipeline.submit(spec(xs=2, ys=1))) == "completed"
        assert faults == [0]

    def test_a_defect_in_the_results_ends_the_run(self, pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch) -> None:
        store = type(pipeline.context.store)
        put = store.put

        def crash(self: Any, key: str, *arguments: Any, **keywords: Any) -> bool:
            if key.startswith(RUNS):
                raise ZeroDivisionError("oops")
            return put(self, key, *arguments, **keywords)

        monkeypatch.setattr(store, "put", crash)
        run = pipeline.submit(spec(xs=2, ys=1))
        assert pipeline.run(run) == "failed"
        assert pipeline.row(run).reason == "the results could not be written: oops"

    def test_a_run_pauses_before_the_last_megabytes(self, pipelines: Callable[..., Pipeline]) -> None:
        pipeline = pipelines(min_free_mb=10**9)
        run = pipeline.submit()
        assert pipeline.run(run, until=["paused"]) == "paused"
        assert "VALERIE_MIN_FREE_MB" in pipeline.row(run).reason


class TestSteering:
    def test_a_cancelled_run_computes_nothing_more_and_resumes_where_it_was(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        pipeline.loop.tick()
        lifecycle.cancel(pipeline.context, run)
        pipeline.step()
        assert pipeline.made() == {}
        assert {product.state for product in pipeline.products()} <= {"parked", "waiting"}
        lifecycle.resume(pipeline.context, run)
        assert pipeline.run(run) == "completed"
        assert pipeline.made() == ALL

    def test_a_cancelled_run_leaves_window_and_queues_to_others(self, pipelines: Callable[..., Pipeline]) -> None:
        pipeline = pipelines()
        large = pipeline.submit(spec(xs=10, ys=10))
        pipeline.loop.tick(everything=True)
        small = pipeline.submit(spec(xs=2, ys=1))  # needs some of the same products
        pipeline.loop.tick(everything=True)
        lifecycle.cancel(pipeline.context, large)
        pipeline.loop.tick(everything=True)
        with reading(pipeline.context.engine) as connection:
            assert totals.unfinished_count(connection) == 2 + 4 * 4
        assert pipeline.run(small) == "completed"
        assert {product.state for product in pipeline.products()} == {"done", "parked"}
        lifecycle.resume(pipeline.context, large)
        assert pipeline.run(large) == "completed"
        assert len(rows(pipeline, large)) == 2 * 200

    def test_an_ended_run_cannot_be_cancelled_and_an_active_one_not_deleted(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        with pytest.raises(Conflict, match="cancel it before"):
            lifecycle.delete(pipeline.context, run)
        pipeline.run(run)
        with pytest.raises(Conflict, match="is completed"):
            lifecycle.cancel(pipeline.context, run)

    def test_deleting_a_run_frees_what_nobody_else_links(self, pipeline: Pipeline) -> None:
        first = pipeline.submit()
        second = pipeline.submit(spec(xs=4, ys=2))
        pipeline.run(first)
        pipeline.run(second)
        lifecycle.delete(pipeline.context, first)
        assert gc.collect(pipeline.context, dry_run=True).products == 4 * 8
        assert gc.collect(pipeline.context).products == 4 * 8
        # Two backgrounds and the statics' truth, which is the same for both cameras of the testing engine.
        assert len(pipeline.products()) == 2 + 1 + 4 * 16
        assert len(list(pipeline.context.store.list(PRODUCTS))) == 2 + 1 + 3 * 16
        assert len(rows(pipeline, second)) == 2 * 16
        with reading(pipeline.context.engine) as connection, pytest.raises(NotFound):
            runs.get(connection, first)


class TestTheControlLoop:
    def test_another_loop_goes_on_where_a_killed_one_stopped(self, pipeline: Pipeline) -> None:
        run = pipeline.submit(spec(xs=30, ys=20))
        pipeline.step()
        killed = pipeline.loop
        pipeline.loop = ControlLoop(pipeline.context)
        assert pipeline.run(run) == "completed"
        assert killed is not pipeline.loop
        assert len(rows(pipeline, run)) == 2 * 1200

    def test_a_small_run_is_fed_beside_a_large_one_that_fills_the_window(
        self, pipelines: Callable[..., Pipeline], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        pipeline = pipelines(feed_window=80)
        monkeypatch.setattr(feeding, "BLOCK_PRODUCTS", 80)
        large = pipeline.submit(spec(xs=10, ys=10))
        while pipeline.loop.tick(everything=True):
            pass
        fed = pipeline.row(large).next_index
        assert 0 < fed < 100
        small = pipeline.submit(spec(xs=2, ys=1, constants={"sun-1.elevation": 12}))
        pipeline.loop.tick(everything=True)
        assert pipeline.row(small).next_index == 2
        assert pipeline.row(large).next_index == fed, "the large run has more than its half already"

    def test_messages_that_a_stopped_broker_refused_are_sent_again(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        pipeline.broker.down = True
        pipeline.step()
        assert pipeline.made() == {}
        pipeline.broker.down = False
        assert pipeline.run(run) == "completed"

    def test_a_run_waits_with_a_reason_until_workers_offer_what_it_needs(
        self, pipelines: Callable[..., Pipeline]
    ) -> None:
        pipeline = pipelines(workers=False)
        run = pipeline.submit()
        pipeline.step()
        assert pipeline.state(run) == "submitted"
        assert "render worker with the engine 'blank'" in pipeline.row(run).reason
        pipeline.add_worker()
        assert pipeline.run(run) == "completed"

    def test_a_run_names_a_queue_that_nobody_serves_only_if_it_needs_it(self, pipeline: Pipeline) -> None:
        run = pipeline.submit()
        pipeline.loop.tick(everything=True)
        layers = Product.__table__.c.kind == ProductKind.LAYER
        with writing(pipeline.context.engine) as connection:
            connection.execute(Product.__table__.update().where(layers).values(route="render.raster.of-another-run"))
        pipeline.loop.tick(everything=True)
        assert pipeline.row(run).reason is None
        with writing(pipeline.context.engine) as connection:
            connection.execute(delete(Worker))
        pipeline.loop.tick(everything=True)
        assert (pipeline.row(run).reason or "").startswith(
            "no living worker serves the queue infer.blank, render.blank"
        )


class TestSubmitting:
    def test_a_repeated_idempotency_key_makes_no_second_run(self, pipeline: Pipeline) -> None:
        first = pipeline.submit(idempotency_key="k")
        assert pipeline.submit(idempotency_key="k") == first
        with pytest.raises(Conflict, match="another spec"):
            pipeline.submit(spec(xs=5, ys=3), idempotency_key="k")

    def test_testing_engines_are_refused_where_the_settings_do_not_allow_them(
        self, pipelines: Callable[..., Pipeline]
    ) -> None:
        pipeline = pipelines()
        pipeline.context = type(pipeline.context)(
            settings=pipeline.settings.model_copy(update={"testing_engines": False}),
            engine=pipeline.context.engine,
            store=pipeline.context.store,
            broker=pipeline.context.broker,
            owner="o",
        )
        with pytest.raises(InvalidInput, match="unknown renderer 'blank'"):
            pipeline.submit()

    def test_an_unknown_parent_run_is_refused(self, pipeline: Pipeline) -> None:
        with pytest.raises(NotFound, match="parent run"):
            pipeline.submit(spec(xs=2, ys=2, parent_run="r000000000000"))
