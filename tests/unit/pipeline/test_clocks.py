"""Clocks that are ahead, or are set back: nothing stands still longer than a lease."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Engine, select, update

from tests.unit.db.rows import digest, write_run
from tests.world.blank import Pipeline
from valerie.db import processes, products, sweeping
from valerie.db.engine import database_time, open_database, reading, writing
from valerie.db.migrate import migrate
from valerie.db.models import Product
from valerie.pipeline.control.loop import ControlLoop

LEASE = 60.0
HOURS = 7200.0


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 1_800_000_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def engine(tmp_path: Path, clock: Clock) -> Iterator[Engine]:
    engine = open_database(f"sqlite:///{tmp_path / 'valerie.sqlite3'}", clock=clock)
    migrate(engine)
    yield engine
    engine.dispose()


def claim(engine: Engine, name: str) -> None:
    with writing(engine) as connection:
        products.promote(connection, [digest(name)], database_time(connection))
        now = database_time(connection)
        assert products.claim(connection, [digest(name)], owner="w", now=now, lease_seconds=LEASE)


def taken_back(engine: Engine) -> list[str]:
    with writing(engine) as connection:
        now = database_time(connection)
        sweeping.bound_times(connection, now=now, lease_seconds=LEASE)
        return [item.digest for item in sweeping.take_back_expired(connection, now=now, max_attempts=3)]


def holds(engine: Engine, owner: str) -> bool:
    with writing(engine) as connection:
        return processes.hold_lease(connection, "control", owner=owner, now=database_time(connection), seconds=LEASE)


def test_a_worker_hours_ahead_that_dies_loses_its_product_after_one_lease(engine: Engine, clock: Clock) -> None:
    write_run(engine)
    clock.now += HOURS
    claim(engine, "b")
    clock.now -= HOURS
    assert taken_back(engine) == []
    clock.now += LEASE + 1
    assert taken_back(engine) == [digest("b")]


def test_a_control_loop_hours_ahead_that_dies_loses_its_role_after_one_lease(engine: Engine, clock: Clock) -> None:
    clock.now += HOURS
    assert holds(engine, "ahead")
    clock.now -= HOURS
    assert not holds(engine, "other")
    clock.now += LEASE + 1
    assert holds(engine, "other")


def test_a_living_control_loop_hours_ahead_keeps_its_role(engine: Engine, clock: Clock) -> None:
    for _ in range(5):
        clock.now += HOURS
        assert holds(engine, "ahead")
        clock.now -= HOURS
        assert not holds(engine, "other")
        clock.now += LEASE / 3


def test_a_message_sent_before_the_clock_was_set_back_is_sent_again(engine: Engine, clock: Clock) -> None:
    write_run(engine)
    with writing(engine) as connection:
        products.promote(connection, [digest("b")], database_time(connection))
    clock.now -= HOURS
    assert taken_back(engine) == []
    with reading(engine) as connection:
        assert sweeping.stale_ready(connection, now=clock.now + 11, resend_seconds=10, limit=9)


def test_a_worker_that_died_before_the_clock_was_set_back_is_dead(engine: Engine, clock: Clock) -> None:
    row = processes.WorkerRow("w", "render", "h", 1, (), started_at=clock.now, seen_at=clock.now)
    with writing(engine) as connection:
        processes.register_worker(connection, row)
    clock.now -= 2e9
    with reading(engine) as connection:
        assert processes.workers(connection, now=database_time(connection)) == []


def test_a_run_ends_although_the_clock_is_set_back_in_the_middle(pipelines: Callable[..., Pipeline]) -> None:
    clock = Clock()
    pipeline = pipelines(resend_seconds=0.001)
    pipeline.context.engine.dispose()
    engine = open_database(pipeline.settings.database_url, clock=clock)
    pipeline.context = replace(pipeline.context, engine=engine)
    pipeline.loop = ControlLoop(pipeline.context)
    run_id = pipeline.submit()
    pipeline.step()
    lost = pipeline.broker.ready[:]
    pipeline.broker.ready.clear()
    assert lost
    clock.now -= HOURS
    pipeline.loop.tick(everything=True)
    clock.now += 1
    assert pipeline.run(run_id) == "completed"


def test_the_time_of_leases_is_not_that_of_the_process(
    engine: Engine, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "time", lambda: 5.0)
    write_run(engine)
    claim(engine, "b")
    with writing(engine) as connection:
        assert connection.scalar(select(Product.lease_until).where(Product.digest == digest("b"))) == clock.now + LEASE
        connection.execute(update(Product).values(lease_until=None))
