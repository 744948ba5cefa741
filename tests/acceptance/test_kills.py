"""kill -9 of every kind of process in the middle of a run: it still ends with the same results, byte for byte."""

from __future__ import annotations

import signal
from collections.abc import Callable

import psutil
import pytest
from sqlalchemy import select

from tests.acceptance.system import System
from tests.world.boxes import spec
from valerie.broker import Broker, create_app
from valerie.db.engine import open_engine, reading
from valerie.db.models import Product
from valerie.db.products import Ready

pytestmark = [pytest.mark.processes, pytest.mark.timeout(480)]

Outcome = tuple[list[dict[str, object]], dict[str, str]]
DOCUMENT = spec(xs=16, ys=12)
FRAMES = 16 * 12 * 2


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, assets) -> Outcome:
    with System(tmp_path_factory.mktemp("undisturbed"), assets) as system:
        run = system.submit(DOCUMENT)
        assert system.wait(run) == "completed"
        return system.rows(run), system.objects()


def outcome(system: System, run: str) -> Outcome:
    assert system.wait(run) == "completed", system.progress(run)
    return system.rows(run), system.objects()


def under_way(progress: dict) -> bool:
    stages = progress["stages"]
    return bool(stages) and 0 < stages["eval"]["done"] < stages["eval"]["total"] // 2


def kill(processes: list[psutil.Process]) -> None:
    for process in processes:
        try:
            process.send_signal(signal.SIGKILL)
        except psutil.NoSuchProcess:
            continue


def test_the_undisturbed_run_has_results(undisturbed: Outcome) -> None:
    rows, objects = undisturbed
    assert len(rows) == 2 * FRAMES  # person-2 is absent and says so
    assert len(objects) == 3 + 3 * FRAMES
    assert {row["pacc"] for row in rows if row["undefined_reason"] is None} == {0.0, 1.0}


@pytest.mark.parametrize("service", ["render", "infer", "eval", "api", "redis"])
def test_a_run_survives_kill_9_of(service: str, undisturbed: Outcome, start: Callable[..., System]) -> None:
    with start(service) as system:
        run = system.submit(DOCUMENT)
        system.wait(run, until=under_way)
        before = system.supervisor.pids()[service]
        kill(system.processes(service))
        assert outcome(system, run) == undisturbed
        assert system.supervisor.pids()[service] != before


@pytest.mark.parametrize("service", ["render", "infer", "eval"])
def test_a_run_survives_kill_9_of_the_child_that_computes(
    service: str, undisturbed: Outcome, start: Callable[..., System]
) -> None:
    with start(service) as system:
        run = system.submit(DOCUMENT)
        system.wait(run, until=under_way)
        worker = [
            p for p in system.processes(service) if p.children() and "multiprocessing" not in " ".join(p.cmdline())
        ]
        kill(worker[0].children() if worker else system.processes(service)[:1])
        assert outcome(system, run) == undisturbed


def test_messages_delivered_twice_change_nothing(undisturbed: Outcome, start: Callable[..., System]) -> None:
    with start("twice") as system:
        run = system.submit(DOCUMENT)
        system.wait(run, until=under_way)
        engine = open_engine(system.settings.database_url)
        with reading(engine) as connection:
            columns = (Product.digest, Product.kind, Product.route, Product.cache_group)
            everything: list[Ready] = [
                Ready(*row) for row in connection.execute(select(*columns).where(Product.route != ""))
            ]
        engine.dispose()
        Broker(create_app(system.supervisor.settings)).send_products(everything)
        assert outcome(system, run) == undisturbed


def test_every_product_was_made_once_when_nothing_died(start: Callable[..., System]) -> None:
    with start("once") as system:
        run = system.submit(DOCUMENT)
        assert system.wait(run) == "completed"
        engine = open_engine(system.settings.database_url)
        with reading(engine) as connection:
            attempts = set(connection.scalars(select(Product.attempts)))
        engine.dispose()
        assert attempts == {1}
