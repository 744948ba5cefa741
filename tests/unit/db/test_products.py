from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from sqlalchemy import Connection, Engine, event, select, update

from tests.unit.db.rows import digest, product, write_run
from valerie.db import claiming, products, publishing, runs, sweeping, totals
from valerie.db.engine import reading, writing
from valerie.db.measured import SeenPerson
from valerie.db.models import PersonView, Product
from valerie.db.products import Wanted
from valerie.db.publishing import Finished, SharedStatics
from valerie.db.statements import insert_ignoring
from valerie.runs.products.frame_keys import FrameKey, FrameProducts
from valerie.runs.products.ready import FailedInput, Fault
from valerie.runs.products.states import UPLOADED_ROUTE, ProductKind
from valerie.runs.products.turns import Turns

NO = Fault(stage=ProductKind.LAYER, type="RenderingError", message="no", attempts=1)
ALL = [digest(name) for name in "bltpe"]


def state_of(engine: Engine, name: str) -> str:
    with reading(engine) as connection:
        return str(connection.scalar(select(Product.state).where(Product.digest == digest(name))))


def attempts_of(engine: Engine, name: str) -> int:
    with reading(engine) as connection:
        return int(connection.scalar(select(Product.attempts).where(Product.digest == digest(name))) or 0)


def make_ready(engine: Engine) -> list[str]:
    with writing(engine) as connection:
        return [item.digest for item in products.promote(connection, ALL, now=100.0)]


def claim(engine: Engine, *names: str, owner: str = "w1", now: float = 100.0) -> list[str]:
    with writing(engine) as connection:
        jobs = claiming.claim(connection, [digest(n) for n in names], owner=owner, now=now, lease_seconds=10.0)
    return [job.digest for job in jobs]


def finish(engine: Engine, *names: str, owner: str = "w1") -> list[str]:
    with writing(engine) as connection:
        publishing.publish(connection, [done(name) for name in names], owner=owner, now=101.0)
    with writing(engine) as connection:
        return [item.digest for item in products.promote_dependents(connection, [digest(n) for n in names], 101.0)]


def done(name: str) -> Finished:
    return Finished(digest(name), bytes=1, pixels=1, cpu_seconds=0.1)


def seen(name: str) -> Finished:
    """A truth with one person, stored over the statics ``s``."""
    measures = {"pixel_area": 5, "pixel_area_percent": 0.1, "pixel_area_amodal": 5}
    return replace(
        done(name),
        person_views=(SeenPerson(24001, measures, None, None),),
        part=SharedStatics(digest("s"), bytes=1, pixels=1),
    )


def views(engine: Engine) -> list[tuple[str, int]]:
    with reading(engine) as connection:
        return [(row.truth, row.instance_id) for row in connection.execute(select(PersonView))]


def known(engine: Engine, name: str) -> bool:
    with reading(engine) as connection:
        return totals.wanted_digests(connection, [digest(name)]) == {digest(name)}


class TestPromote:
    def test_only_what_waits_for_nothing_becomes_ready(self, engine: Engine) -> None:
        write_run(engine)
        assert sorted(make_ready(engine)) == sorted([digest("b"), digest("l"), digest("t")])
        assert state_of(engine, "p") == "waiting"

    def test_a_second_call_returns_nothing(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        assert make_ready(engine) == []

    def test_a_product_becomes_ready_when_its_last_input_is_done(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b", "l", "t")
        assert finish(engine, "l", "t") == []
        assert finish(engine, "b") == [digest("p")]
        claim(engine, "p")
        assert finish(engine, "p") == [digest("e")]


WANTED: list[Wanted] = [
    Wanted(digest("b"), ProductKind.BACKGROUND, "render", "g"),
    Wanted(digest("l"), ProductKind.LAYER, "render", "g"),
    Wanted(digest("p"), ProductKind.PREDICTION, "infer", "g", digest("l"), digest("b")),
]


def want(engine: Engine, rows: list[Wanted], now: float = 100.0) -> list[str]:
    with writing(engine) as connection:
        return [item.digest for item in products.want(connection, rows, now, Turns())]


def set_state(engine: Engine, name: str, state: str) -> None:
    with writing(engine) as connection:
        values = {"state": state, "attempts": 2, "error": NO, "sent_at": 1.0}
        connection.execute(update(Product).where(Product.digest == digest(name)).values(**values))


class TestWant:
    def test_new_products_are_ready_or_wait_for_their_inputs(self, engine: Engine) -> None:
        assert want(engine, WANTED) == [digest("b"), digest("l")]
        assert [state_of(engine, name) for name in "blp"] == ["ready", "ready", "waiting"]

    def test_a_new_product_whose_inputs_are_done_is_ready(self, engine: Engine) -> None:
        want(engine, WANTED[:2])
        for name in "bl":
            set_state(engine, name, "done")
        assert want(engine, WANTED) == [digest("p")]
        assert state_of(engine, "p") == "ready"

    def test_inputs_need_not_be_wanted_beside_it(self, engine: Engine) -> None:
        want(engine, WANTED[:2])
        for name in "bl":
            set_state(engine, name, "done")
        assert want(engine, WANTED[2:]) == [digest("p")]

    @pytest.mark.parametrize("state", ["waiting", "ready", "running", "done"])
    def test_what_is_under_way_or_done_is_left_alone(self, engine: Engine, state: str) -> None:
        want(engine, WANTED[:1])
        set_state(engine, "b", state)
        assert want(engine, WANTED[:1]) == []
        assert state_of(engine, "b") == state
        assert attempts_of(engine, "b") == 2

    @pytest.mark.parametrize("state", ["failed", "parked"])
    def test_what_failed_or_was_parked_is_tried_again(self, engine: Engine, state: str) -> None:
        want(engine, WANTED)
        for name in "blp":
            set_state(engine, name, state)
        assert want(engine, WANTED) == [digest("b"), digest("l")]
        assert [state_of(engine, name) for name in "blp"] == ["ready", "ready", "waiting"]
        assert [attempts_of(engine, name) for name in "blp"] == [0, 0, 0]

    def test_no_message_is_sent_for_predictions_that_are_to_be_uploaded(self, engine: Engine) -> None:
        uploaded = Wanted(digest("p"), ProductKind.PREDICTION, UPLOADED_ROUTE, "g")
        assert want(engine, [uploaded]) == []
        assert state_of(engine, "p") == "ready"

    def test_a_ready_product_with_an_earlier_turn_is_announced_again(self, engine: Engine) -> None:
        assert turns_announced(engine, start=5.0) == [5.0]
        assert turns_announced(engine, start=2.0) == [2.0]
        assert turns_announced(engine, start=3.0) == []

    def test_a_run_begins_at_the_turn_of_work_and_not_of_uploads(self, engine: Engine) -> None:
        uploaded = Wanted(digest("p"), ProductKind.PREDICTION, UPLOADED_ROUTE, "g")
        with writing(engine) as connection:
            products.want(connection, [uploaded], 100.0, Turns(3.0))
            assert products.present_turns(connection) == {}
            products.want(connection, WANTED[:1], 100.0, Turns(7.0))
            assert products.present_turns(connection) == {"": 7.0}


def turns_announced(engine: Engine, start: float) -> list[float]:
    """Turns in the messages about the background, for a run that begins at a turn."""
    with writing(engine) as connection:
        return [item.turn for item in products.want(connection, WANTED[:1], 100.0, Turns(start))]


class TestClaim:
    def test_of_two_workers_one_gets_a_product(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        assert claim(engine, "b", "l", owner="w1") == [digest("b"), digest("l")]
        assert claim(engine, "b", "l", "t", owner="w2") == [digest("t")]

    def test_a_message_for_a_finished_product_is_dropped(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b")
        finish(engine, "b")
        assert claim(engine, "b") == []
        assert attempts_of(engine, "b") == 1

    @pytest.mark.parametrize("state", ["cancelled", "paused"])
    def test_what_no_running_run_links_is_parked(self, engine: Engine, state: str) -> None:
        write_run(engine)
        make_ready(engine)
        with writing(engine) as connection:
            assert runs.change_state(connection, "r1", expected=("running",), state=state)
        assert claim(engine, "b") == []
        assert state_of(engine, "b") == "parked"

    def test_another_running_run_keeps_a_shared_product_wanted(self, engine: Engine) -> None:
        write_run(engine, "r1", state="cancelled")
        write_run(engine, "r2")
        make_ready(engine)
        assert claim(engine, "l") == [digest("l")]

    def test_a_job_says_where_the_product_comes_from(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        with writing(engine) as connection:
            (job,) = claiming.claim(connection, [digest("t")], owner="w", now=0.0, lease_seconds=1.0)
        assert (job.frame.key, job.frame.assignment) == (FrameKey("r1", 0, 0), {"x": 1})
        assert job.frame.products == FrameProducts(digest("b"), digest("l"), digest("t"))


class TestPublish:
    def test_a_worker_that_lost_its_lease_changes_nothing(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b", owner="w1")
        with writing(engine) as connection:
            sweeping.take_back_expired(connection, now=111.0, max_attempts=3)
        claim(engine, "b", owner="w2", now=112.0)
        finish(engine, "b", owner="w1")
        assert state_of(engine, "b") == "running"
        finish(engine, "b", owner="w2")
        assert state_of(engine, "b") == "done"

    def test_a_product_freed_after_its_lease_was_lost_harms_no_other(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b", "t")
        with writing(engine) as connection:
            sweeping.free(connection, [digest("t")])
            published = publishing.publish(connection, [done("b"), seen("t")], owner="w1", now=101.0)
        assert published == [digest("b")]
        assert state_of(engine, "b") == "done"
        assert views(engine) == []

    def test_a_worker_that_lost_its_lease_writes_no_rows_beside_the_new_holder(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "t", owner="w1")
        with writing(engine) as connection:
            sweeping.take_back_expired(connection, now=111.0, max_attempts=3)
        claim(engine, "t", owner="w2", now=112.0)
        with writing(engine) as connection:
            assert publishing.publish(connection, [seen("t")], owner="w1", now=113.0) == []
        assert (views(engine), known(engine, "s")) == ([], False)
        with writing(engine) as connection:
            assert publishing.publish(connection, [seen("t")], owner="w2", now=114.0) == [digest("t")]
        assert (views(engine), known(engine, "s")) == ([(digest("t"), 24001)], True)


class TestTakeBackExpired:
    def test_a_living_lease_is_left_alone(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b")
        with writing(engine) as connection:
            claiming.renew(connection, [digest("b")], owner="w1", until=120.0)
            assert sweeping.take_back_expired(connection, now=115.0, max_attempts=3) == []

    def test_what_killed_its_worker_too_often_fails_with_all_that_waits_for_it(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        for attempt in range(2):
            assert claim(engine, "l", now=100.0 + 20 * attempt) == [digest("l")]
            with writing(engine) as connection:
                sweeping.take_back_expired(connection, now=115.0 + 20 * attempt, max_attempts=2)
        assert [state_of(engine, name) for name in "lpe"] == ["failed", "failed", "failed"]
        with reading(engine) as connection:
            errors = {row.digest: row.error for row in connection.execute(select(Product.digest, Product.error))}
        assert errors[digest("l")].type == "WorkerLost"
        assert errors[digest("p")] == FailedInput(cause=digest("l"))
        assert errors[digest("e")] == FailedInput(cause=digest("p"))


class TestRevive:
    def test_a_failed_chain_is_tried_again_from_its_root(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "l")
        with writing(engine) as connection:
            products.fail(connection, digest("l"), owner="w1", error=NO, now=1.0)
        assert state_of(engine, "e") == "failed"
        with writing(engine) as connection:
            products.revive(connection, ALL)
            ready = products.promote(connection, ALL, now=2.0)
        assert digest("l") in [item.digest for item in ready]
        assert attempts_of(engine, "l") == 0
        assert [state_of(engine, name) for name in "pe"] == ["waiting", "waiting"]


class TestHandBack:
    def test_a_pause_for_storage_does_not_count_as_an_attempt(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b")
        with writing(engine) as connection:
            claiming.hand_back(connection, [digest("b")], owner="w1", not_before=0.0, count_attempt=False)
        assert state_of(engine, "b") == "ready"
        assert attempts_of(engine, "b") == 0


class TestForget:
    def test_a_lost_input_is_made_again_and_its_reader_waits(self, engine: Engine) -> None:
        write_run(engine)
        make_ready(engine)
        claim(engine, "b", "l")
        finish(engine, "b", "l")
        claim(engine, "p")
        with writing(engine) as connection:
            claiming.await_inputs(connection, [digest("p")], owner="w1")
            products.forget(connection, [digest("l")])
            ready = products.promote(connection, [digest("l")], now=3.0)
        assert [item.digest for item in ready] == [digest("l")]
        assert state_of(engine, "p") == "waiting"
        claim(engine, "l")
        assert finish(engine, "l") == [digest("p")]


class TestUnlinked:
    def test_only_what_no_run_links_is_free(self, engine: Engine) -> None:
        write_run(engine)
        with writing(engine) as connection:
            insert_ignoring(connection, Product, [product("x", "layer", state="done")])
            assert sweeping.unlinked(connection, limit=10) == [(digest("x"), "layer")]
            runs.remove(connection, "r1")
            assert {one.digest for one in sweeping.unlinked(connection, limit=10)} == {*ALL, digest("x")}


class TestTotals:
    def test_they_equal_a_scan_of_all_products(self, engine: Engine) -> None:
        write_run(engine)
        ends = [("x1", "layer", "done", 1.5), ("x2", "layer", "done", 0.25), ("x3", "layer", "failed", None)]
        ends += [("x4", "truth", "done", 2.0), ("x5", "prediction", "parked", 7.0)]
        with writing(engine) as connection:
            for name, kind, state, seconds in ends:
                row = {**product(name, kind, state=state), "cpu_seconds": seconds, "finished_at": 5.0}
                insert_ignoring(connection, Product, [row])
            sums = totals.totals(connection)
            rows = connection.execute(select(Product.kind, Product.state, Product.cpu_seconds)).all()
        scanned = {kind: [0, 0, 0.0] for kind in ProductKind}
        for kind, state, seconds in rows:
            scanned[kind][0] += state == "done"
            scanned[kind][1] += state == "failed"
            scanned[kind][2] += seconds if state == "done" else 0.0
        assert {kind: [*rest] for kind, *rest in sums} == scanned


class TestRecordedCosts:
    def test_the_dearest_is_left_out_unless_it_is_alone(self, engine: Engine) -> None:
        with writing(engine) as connection:
            for number, seconds in enumerate([20.0, 1.0, 3.0]):
                row = {**product(f"x{number}", "layer", state="done"), "finished_at": float(number), "pixels": 100}
                insert_ignoring(connection, Product, [row | {"cpu_seconds": seconds, "bytes": 10}])
            assert [
                (recorded_cost.count, recorded_cost.cpu_seconds) for recorded_cost in totals.recorded_costs(connection)
            ] == [(3, 2.0)]
            assert [
                (recorded_cost.count, recorded_cost.cpu_seconds)
                for recorded_cost in totals.recorded_costs(connection, sample=1)
            ] == [(1, 3.0)]

    def test_they_are_means_over_the_newest_of_each_kind(self, engine: Engine) -> None:
        with writing(engine) as connection:
            for number in range(6):
                row = {**product(f"x{number}", "layer", state="done"), "finished_at": float(number)}
                row |= {"cpu_seconds": float(number), "bytes": 10 * number, "pixels": 100}
                insert_ignoring(connection, Product, [row])
            costs = totals.recorded_costs(connection, sample=2)
        assert costs == [totals.RecordedCost(ProductKind.LAYER, "render", "", 100, 2, 4.0, 45.0)]


def plans_of(engine: Engine, ask: Callable[[Connection], object]) -> list[tuple[str, list[str]]]:
    """Every statement about products that ``ask`` runs, with the steps of its query plan."""
    statements: list[tuple[str, Any]] = []

    def note(_connection: Any, _cursor: Any, statement: str, parameters: Any, *_: Any) -> None:
        statements.append((statement, parameters))

    event.listen(engine, "before_cursor_execute", note)
    with writing(engine) as connection:
        ask(connection)
    event.remove(engine, "before_cursor_execute", note)
    about_products = [(sql, values) for sql, values in statements if "products" in sql]
    with reading(engine) as connection:
        return [
            (sql, [str(row[3]) for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {sql}", values)])
            for sql, values in about_products
        ]


class TestCost:
    @pytest.mark.parametrize(
        "ask",
        [
            totals.unfinished_count,
            totals.backlog,
            lambda connection: sweeping.take_back_expired(connection, now=100.0, max_attempts=3),
            lambda connection: products.promote_all(connection, 100.0),
            lambda connection: sweeping.stale_ready(connection, now=100.0, resend_seconds=9.0, limit=10),
            lambda connection: sweeping.fail_orphaned_dependents(connection, 100.0),
            lambda connection: products.promote_dependents(connection, [digest("l")], 100.0),
            lambda connection: products.fail_dependents(connection, [digest("l")], 100.0),
            totals.recorded_costs,
        ],
    )
    def test_what_is_asked_all_the_time_does_not_read_finished_products(
        self, engine: Engine, ask: Callable[[Connection], object]
    ) -> None:
        write_run(engine)
        plans = plans_of(engine, ask)
        assert plans
        for sql, steps in plans:
            assert not [step for step in steps if "SCAN products" in step and "INDEX" not in step], (sql, steps)

    @pytest.mark.parametrize("ask", [products.promote_dependents, products.fail_dependents])
    def test_what_waits_is_found_by_its_inputs(self, engine: Engine, ask: Callable[..., object]) -> None:
        write_run(engine)
        ((sql, steps),) = plans_of(engine, lambda connection: ask(connection, [digest("x")], 100.0))
        assert {index for index in ("a", "b", "c") if any(f"ix_products_input_{index}" in step for step in steps)} == {
            "a",
            "b",
            "c",
        }, (sql, steps)

    def test_totals_read_an_index_alone(self, engine: Engine) -> None:
        ((sql, steps),) = plans_of(engine, totals.totals)
        assert any("COVERING INDEX ix_products_ended" in step for step in steps), (sql, steps)
