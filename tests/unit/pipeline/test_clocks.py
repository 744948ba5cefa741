"""Clocks that are ahead, or are set back: nothing stands still longer than a lease."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import Engine, select, update

from tests.unit.db.rows import digest, write_run
from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie.db import claiming, deliveries, processes, products, studies, sweeping
from valerie.db.engine import database_time, open_database, reading, writing
from valerie.db.migrate import migrate
from valerie.db.models import Product
from valerie.errors import InvalidInput
from valerie.pipeline.control import gc, lifecycle
from valerie.pipeline.control.loop import ControlLoop
from valerie.pipeline.control.studies import commands
from valerie.runs.moments import moment_text
from valerie.runs.study.study_document import StudyDocument, parse_study
from valerie.storage import ArtifactStore
from valerie.storage.keys import product_key
from valerie.storage.store import ObjectInfo

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
        assert claiming.claim(connection, [digest(name)], owner="w", now=now, lease_seconds=LEASE)


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


@pytest.fixture
def apart(pipelines: Callable[..., Pipeline], clock: Clock) -> Iterator[Pipeline]:
    """A pipeline whose process is not of the database's time."""
    pipeline = pipelines()
    pipeline.context.engine.dispose()
    engine = open_database(pipeline.settings.database_url, clock=clock)
    pipeline.context = replace(pipeline.context, engine=engine)
    pipeline.loop = ControlLoop(pipeline.context)
    yield pipeline
    engine.dispose()


def test_the_times_of_a_run_are_the_databases_so_that_its_end_is_told(apart: Pipeline, clock: Clock) -> None:
    now = datetime.fromtimestamp(clock.now, UTC)
    run_id = apart.submit()
    lifecycle.cancel(apart.context, run_id)
    row = apart.row(run_id)
    assert row.finished_at is not None
    assert (row.created_at, row.finished_at) == (now, now)
    with reading(apart.context.engine) as connection:
        # As webhooks ask: endings of the last day.
        endings = deliveries.due(connection, "r", since=now - timedelta(days=1), now=clock.now, limit=9)
    assert [ending.id for ending in endings] == [run_id]


def study_until(deadline: datetime) -> StudyDocument:
    return parse_study(
        {
            **spec(vary=[["person-1.pos.x", "UNIFORM", -3, 3]]),
            "measure": "min(pacc) >= 0.5",
            "goal": "estimate",
            "budget": {"variants": 40, "deadline": deadline.isoformat()},
            "batch": 8,
        }
    )


def test_the_deadline_of_a_study_is_of_the_databases_time(apart: Pipeline, clock: Clock) -> None:
    deadline = datetime.fromtimestamp(clock.now + 60.0, UTC)
    study = commands.begin(apart.context, study_until(deadline))
    clock.now += 120.0
    apart.loop.tick(everything=True)
    with reading(apart.context.engine) as connection:
        row = studies.get(connection, study)
    assert (row.state, row.reason) == ("finished", f"the deadline has passed: {moment_text(deadline)}")


def test_a_study_whose_deadline_has_passed_is_refused(apart: Pipeline, clock: Clock) -> None:
    passed = datetime.fromtimestamp(clock.now - 60.0, UTC)
    message = f"budget.deadline: the deadline has passed; got {moment_text(passed)}; limit: a moment after"
    for start in (commands.plan_study, commands.begin):
        with pytest.raises(InvalidInput, match=re.escape(message)):
            start(apart.context, study_until(passed))


class _Behind(ArtifactStore):
    """A store that dates its objects by a clock two hours behind the process's."""

    def __init__(self, store: ArtifactStore) -> None:
        vars(self).update(vars(store))

    def head(self, key: str) -> ObjectInfo:
        return self._dated(super().head(key))

    def list(self, prefix: str = "") -> Iterator[ObjectInfo]:
        return map(self._dated, super().list(prefix))

    def _dated(self, info: ObjectInfo) -> ObjectInfo:
        return replace(info, modified=info.modified - timedelta(seconds=HOURS))


def test_an_object_that_was_stored_just_now_stays_although_the_stores_clock_is_behind(pipeline: Pipeline) -> None:
    key = product_key("truth", digest("e"))
    pipeline.context.store.put(key, b"its row follows")
    gc.collect(replace(pipeline.context, store=_Behind(pipeline.context.store)))
    assert pipeline.context.store.exists(key)


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
