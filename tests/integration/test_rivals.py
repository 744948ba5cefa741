"""Processes that do the same at the same moment: finish a run, feed a run and steer it; on both databases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select, update

from tests.integration.waiting import locked, wait_for_locks
from tests.world.blank import Pipeline
from tests.world.boxes import write_box_street
from valerie.db import processes
from valerie.db.engine import reading, writing
from valerie.db.models import Frame, Lease, Product, Run
from valerie.db.runs import RunRow
from valerie.pipeline.base.context import Context
from valerie.pipeline.control import feeding, lifecycle
from valerie.pipeline.work.finish import Keep, finish_run
from valerie.runs.products.states import ProductState, RunState
from valerie.storage.keys import run_key

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture
def pipelines(tmp_path: Path) -> Iterator[Callable[..., Pipeline]]:
    write_box_street(tmp_path / "assets" / "box-street")
    opened: list[Pipeline] = []

    def pipeline(**settings: object) -> Pipeline:
        opened.append(Pipeline(tmp_path / "data", tmp_path / "assets", **settings))
        return opened[-1]

    yield pipeline
    for world in opened:
        world.context.engine.dispose()


@pytest.fixture(params=["sqlite", "postgres"])
def finishing(
    request: pytest.FixtureRequest, new_database: Callable[[], str], pipelines: Callable[..., Pipeline]
) -> tuple[Pipeline, str]:
    """A run whose products are done, and that nobody has finished."""
    pipeline = pipelines(**({"database_url": new_database()} if request.param == "postgres" else {}))
    run = pipeline.submit()
    assert pipeline.run(run, until=["finishing"]) == "finishing"
    return pipeline, run


def test_one_process_at_a_time_finishes_a_run(finishing: tuple[Pipeline, str]) -> None:
    pipeline, run = finishing
    rival = replace(pipeline.context, owner="rival")
    documents: list[str] = []

    def write(*_: object) -> None:
        documents.append("first")
        # The control loop has sent its message again meanwhile.
        assert not finish_run(rival, run, write=lambda *_: documents.append("second"))

    assert finish_run(pipeline.context, run, write=write)
    assert (documents, pipeline.state(run)) == (["first"], RunState.COMPLETED)
    assert not finish_run(rival, run)
    with reading(pipeline.context.engine) as connection:
        assert connection.scalars(select(Lease.name).where(Lease.name.like("finish.%"))).all() == []


def test_a_process_that_wakes_after_its_successor_finished_does_not_end_the_run_that_is_tried_again(
    finishing: tuple[Pipeline, str],
) -> None:
    pipeline, run = finishing
    successor = replace(pipeline.context, owner="successor")

    def write(_context: Context, _run: RunRow, _failures: object, keep: Keep) -> None:
        keep("environment.json", b"before")
        # This process slept longer than its lease.
        with writing(pipeline.context.engine) as connection:
            connection.execute(update(Lease).where(Lease.name.like("finish.%")).values(until=1.0))
        assert finish_run(successor, run, write=lambda *_: None)
        assert pipeline.state(run) == RunState.COMPLETED
        with writing(pipeline.context.engine) as connection:
            processes.hold_lease(connection, f"finish.{run}", owner="third", now=2.0, seconds=60.0)
            # Someone tries the run's failed products again, and they are done.
            connection.execute(update(Run).values(state=RunState.FINISHING))
        keep("environment.json", b"stale")

    assert not finish_run(pipeline.context, run, write=write)
    assert pipeline.context.store.get(run_key(run, "environment.json")) == b"before"
    assert pipeline.state(run) == RunState.FINISHING, "the third process ends it"


@pytest.fixture
def fed(
    new_database: Callable[[], str], pipelines: Callable[..., Pipeline], monkeypatch: pytest.MonkeyPatch
) -> tuple[Pipeline, RunRow, tuple[str, str]]:
    """A run on Postgres of which one block is written, and the two backgrounds that all its blocks want."""
    monkeypatch.setattr(feeding, "BLOCK_PRODUCTS", 40)
    pipeline = pipelines(database_url=new_database(), feed_window=1)
    run = pipeline.submit()
    pipeline.loop.tick(everything=True)
    with reading(pipeline.context.engine) as connection:
        first, second = sorted(connection.scalars(select(Frame.background).distinct()))
    return pipeline, pipeline.row(run), (first, second)


def test_a_control_loop_that_lost_its_role_and_its_successor_write_a_block_once(
    fed: tuple[Pipeline, RunRow, tuple[str, str]],
) -> None:
    pipeline, row, (_, second) = fed
    engine = pipeline.context.engine
    feeders = [feeding.Feeder(row, pipeline.settings) for _ in range(2)]
    with ThreadPoolExecutor(2) as executor:
        with locked(engine, second):
            answers = []
            for feeder in feeders:
                answers.append(executor.submit(feeder.feed, engine, row.next_index, 1.0))
                wait_for_locks(engine, len(answers))
        assert [answer.result().products > 0 for answer in answers] == [True, False]


def test_a_run_is_steered_between_two_blocks(fed: tuple[Pipeline, RunRow, tuple[str, str]]) -> None:
    pipeline, row, (first, second) = fed
    engine, run = pipeline.context.engine, row.id
    with writing(engine) as connection:
        connection.execute(update(Product).where(Product.digest == first).values(state=ProductState.PARKED))
    feeder = feeding.Feeder(row, pipeline.settings)

    def steer() -> None:
        lifecycle.cancel(pipeline.context, run)
        lifecycle.resume(pipeline.context, run)

    with ThreadPoolExecutor(2) as executor:
        with locked(engine, second):
            # Holds the first background, and will write the run's row.
            answers: list[Future[object]] = [executor.submit(feeder.feed, engine, row.next_index, 1.0)]
            wait_for_locks(engine, 1)
            answers.append(executor.submit(steer))
            wait_for_locks(engine, 2)
        for answer in answers:
            answer.result()
    assert pipeline.state(run) == RunState.RUNNING
    assert pipeline.row(run).next_index > row.next_index
