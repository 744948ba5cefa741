"""Transactions that write several products at once, on Postgres: none waits for one that waits for it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from sqlalchemy import Connection, Engine, func, insert, inspect, select, text, update

from tests.integration.waiting import locked, wait_for_locks
from valerie.db import claiming, products, publishing, sweeping
from valerie.db.engine import writing
from valerie.db.models import Product
from valerie.db.products import Wanted
from valerie.db.publishing import Finished
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind, ProductState
from valerie.runs.products.turns import Turns

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

OWNER = "w"
FAULT = Fault(stage=ProductKind.LAYER, type="RenderingError", message="no", attempts=1)


def digest(name: str) -> str:
    return name.ljust(32, "0")


A, B, C = digest("a"), digest("b"), digest("c")
ALL = [A, B, C]


@pytest.fixture
def engine(engine: Engine) -> Engine:
    with writing(engine) as connection:
        # Of two plans one reads the table and one the index of the primary key, which have the rows in opposite orders.
        for index in inspect(connection).get_indexes("products"):
            connection.execute(text(f'DROP INDEX "{index["name"]}"'))
        for name in (C, B, A):
            products.want(connection, [Wanted(name, ProductKind.LAYER, "render", "g")], 0.0, Turns())
    return engine


def set_state(engine: Engine, state: ProductState) -> None:
    with writing(engine) as connection:
        connection.execute(update(Product).values(state=state, lease_owner=OWNER, lease_until=0.0))


def publish(connection: Connection) -> None:
    finished = [Finished(name, bytes=1, pixels=1, cpu_seconds=0.5) for name in ALL]
    publishing.publish(connection, finished, owner=OWNER, now=1.0)


def renew(connection: Connection) -> None:
    claiming.renew(connection, ALL, owner=OWNER, until=9.0)


def hand_back(connection: Connection) -> None:
    claiming.hand_back(connection, ALL, owner=OWNER, not_before=1.0)


def await_inputs(connection: Connection) -> None:
    claiming.await_inputs(connection, ALL, owner=OWNER)


def want(connection: Connection) -> None:
    products.want(connection, [Wanted(name, ProductKind.LAYER, "render", "g") for name in ALL], 2.0, Turns())


def take_back(connection: Connection) -> None:
    sweeping.take_back_expired(connection, now=5.0, max_attempts=9)


def claim(connection: Connection) -> None:
    claiming.claim(connection, ALL, owner="other", now=1.0, lease_seconds=60.0)


def mark_sent(connection: Connection) -> None:
    sweeping.mark_sent(connection, ALL, 3.0)


def revive(connection: Connection) -> None:
    products.revive(connection, ALL)


def promote(connection: Connection) -> None:
    products.promote_all(connection, 3.0)


def forget(connection: Connection) -> None:
    products.forget(connection, ALL)


RUNNING = [publish, renew, hand_back, await_inputs, want, take_back]


@pytest.mark.parametrize(
    ("state", "operation"),
    [
        *((ProductState.RUNNING, operation) for operation in RUNNING),
        (ProductState.READY, claim),
        (ProductState.READY, mark_sent),
        (ProductState.FAILED, revive),
        (ProductState.WAITING, promote),
        (ProductState.DONE, forget),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_products_are_locked_in_the_order_of_their_digests_whatever_the_plan(
    engine: Engine, state: ProductState, operation: Callable[[Connection], None]
) -> None:
    set_state(engine, state)

    def run(plan: str, body: Callable[[Connection], None]) -> None:
        with writing(engine) as connection:
            for kind in ("seqscan", "indexscan", "indexonlyscan", "bitmapscan"):
                connection.execute(text(f"SET LOCAL enable_{kind} = {'on' if kind == plan else 'off'}"))
            body(connection)

    with ThreadPoolExecutor(2) as executor:
        # Both wait for the row in the middle. One that reads the table would hold the last row by then, one that reads the
        # index the first.
        with locked(engine, B):
            answers: list[Future[None]] = []
            for plan, body in (("seqscan", operation), ("indexscan", want)):
                answers.append(executor.submit(run, plan, body))
                wait_for_locks(engine, len(answers))
        for answer in answers:
            answer.result()


def test_a_failure_passed_on_and_a_run_that_wants_the_same_products_do_not_wait_for_each_other(engine: Engine) -> None:
    with writing(engine) as connection:
        # The later digest is the input of the earlier one.
        connection.execute(update(Product).where(Product.digest == A).values(state="waiting", input_a=C))
        connection.execute(update(Product).where(Product.digest == C).values(state="running", lease_owner=OWNER))

    def fail() -> None:
        with writing(engine) as connection:
            products.fail(connection, C, owner=OWNER, error=FAULT, now=1.0)

    def wanting() -> None:
        with writing(engine) as connection:
            want(connection)

    with ThreadPoolExecutor(2) as executor:
        with locked(engine, B):
            answers = [executor.submit(wanting)]  # holds a, waits for b
            wait_for_locks(engine, 1)
            answers.append(executor.submit(fail))
            wait_for_locks(engine, 2)
        for answer in answers:
            answer.result()
    with writing(engine) as connection:
        states = dict(connection.execute(select(Product.digest, Product.state)).all())
    assert states[C] is ProductState.FAILED


def test_products_are_not_freed_while_a_run_is_about_to_link_them(engine: Engine) -> None:
    set_state(engine, ProductState.PARKED)
    new = Wanted(digest("d"), ProductKind.LAYER, "render", "g")

    def wanting() -> None:
        with writing(engine) as connection:
            products.want(connection, [*(Wanted(n, ProductKind.LAYER, "render", "g") for n in ALL), new], 2.0, Turns())

    def free() -> list[str]:
        with writing(engine) as connection:
            unlinked = [product.digest for product in sweeping.unlinked(connection, limit=10)]
            sweeping.free(connection, unlinked)
        return unlinked

    with ThreadPoolExecutor(2) as executor:
        with locked(engine, B):
            linking = executor.submit(wanting)
            wait_for_locks(engine, 1)
            freeing = executor.submit(free)
            wait_for_locks(engine, 2)
        linking.result()
        # Nothing links them here, so they go after the transaction that wanted them.
        assert sorted(freeing.result()) == [*ALL, new.digest]
    with writing(engine) as connection:
        assert connection.scalar(select(func.count()).select_from(Product)) == 0


def test_two_workers_that_store_truths_over_the_same_new_statics_do_not_wait_for_each_other(engine: Engine) -> None:
    names = {"one": [digest(f"one{i}") for i in range(3)], "two": [digest(f"two{i}") for i in range(3)]}
    statics = [publishing.SharedStatics(digest(f"s{i}"), bytes=1, pixels=1) for i in range(3)]
    with writing(engine) as connection:
        for owner, digests in names.items():
            products.want(connection, [Wanted(n, ProductKind.TRUTH, "render", "g") for n in digests], 0.0, Turns())
            condition = Product.digest.in_(digests)
            connection.execute(update(Product).where(condition).values(state="running", lease_owner=owner))

    def store(owner: str, parts: list[publishing.SharedStatics]) -> list[str]:
        pairs = zip(names[owner], parts, strict=True)
        finished = [Finished(name, bytes=1, pixels=1, cpu_seconds=0.5, part=part) for name, part in pairs]
        with writing(engine) as connection:
            return publishing.publish(connection, finished, owner=owner, now=1.0)

    with ThreadPoolExecutor(2) as executor:
        with engine.connect() as connection:
            # A third worker has inserted the ones in the middle, and fails to commit.
            row = {"kind": "statics", "state": "done", "route": "", "cache_group": ""}
            connection.execute(insert(Product).values(digest=statics[1].digest, **row))
            answers = {"one": executor.submit(store, "one", statics)}
            wait_for_locks(engine, 1)
            answers["two"] = executor.submit(store, "two", statics[::-1])
            wait_for_locks(engine, 2)
            connection.rollback()
        assert {owner: answer.result() for owner, answer in answers.items()} == names
