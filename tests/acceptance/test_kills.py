"""kill -9 of every kind of process in the middle of a run: it still ends with the same results, byte for byte."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import func, select

from tests.acceptance.system import ENDED, System
from tests.chaos import schedule
from tests.chaos.faults import STORM, Target
from tests.chaos.watching import Happened
from tests.world.boxes import spec, write_box_street
from tests.world.processes import kill
from valerie.db.engine import reading
from valerie.db.models import Product
from valerie.db.products import Ready
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control import gc
from valerie.runs.products.states import ProductKind, ProductState

pytestmark = [pytest.mark.processes, pytest.mark.timeout(480)]

Outcome = tuple[list[dict[str, object]], dict[str, str]]
DOCUMENT = spec(xs=10, ys=8)
FRAMES = 10 * 8 * 2


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    """One system for all tests: what was killed works again before the next run."""
    folder = tmp_path_factory.mktemp("system")
    write_box_street(folder / "assets" / "box-street")
    with System(folder / "data", folder / "assets") as system:
        yield system


@pytest.fixture(scope="module")
def context(system: System) -> Iterator[Context]:
    """The context of a command beside the system."""
    context = open_context(system.supervisor.settings)
    yield context
    context.engine.dispose()


@pytest.fixture(scope="module")
def undisturbed(system: System, context: Context) -> tuple[Outcome, set[int]]:
    """Return results and products of a run in peace, and the numbers of attempts at its products."""
    run = system.submit(DOCUMENT)
    assert system.wait(run) == "completed"
    with reading(context.engine) as connection:
        attempts = set(connection.scalars(select(Product.attempts)))
    return outcome(system, context, run), attempts


def outcome(system: System, context: Context, run: str) -> Outcome:
    """Wait for a run and return what it made; the next run makes everything again."""
    assert system.wait(run) == "completed", system.progress(run)
    rows, objects = system.rows(run), system.objects()
    system.client.delete(f"/v1/runs/{run}").raise_for_status()
    gc.collect(context)
    assert not system.objects()
    return rows, objects


def begin(system: System, context: Context) -> str:
    """Submit the run and return when it is in the middle.

    Evaluations are counted in the database: progress is counted twice a second at most, and a fast machine ends runs meanwhile.
    """
    done = select(func.count()).where(Product.kind == ProductKind.EVALUATION, Product.state == ProductState.DONE)

    def evaluated() -> int:
        with reading(context.engine) as connection:
            return connection.scalar(done) or 0

    before = evaluated()
    run = system.submit(DOCUMENT)

    def under_way(_: dict[str, Any]) -> bool:
        return 0 < evaluated() - before < FRAMES

    assert system.wait(run, until=under_way) not in ENDED
    return run


def test_the_undisturbed_run_has_results_and_makes_every_product_once(undisturbed: tuple[Outcome, set[int]]) -> None:
    (rows, objects), attempts = undisturbed
    assert len(rows) == 2 * FRAMES  # person-2 is absent and says so
    assert len(objects) == 3 + 3 * FRAMES
    assert {row["pacc"] for row in rows if row["undefined_reason"] is None} == {0.0, 1.0}
    assert attempts == {1}


@pytest.mark.parametrize("service", ["render", "infer", "eval", "api", "redis"])
def test_a_run_survives_kill_9_of(
    service: str, undisturbed: tuple[Outcome, set[int]], system: System, context: Context
) -> None:
    run = begin(system, context)
    before = system.supervisor.pids()[service]
    kill(system.processes(service))
    assert outcome(system, context, run) == undisturbed[0]
    assert system.supervisor.pids()[service] != before


@pytest.mark.parametrize("service", ["render", "infer", "eval"])
def test_a_run_survives_kill_9_of_the_child_that_computes(
    service: str, undisturbed: tuple[Outcome, set[int]], system: System, context: Context
) -> None:
    run = begin(system, context)
    kill(system.computing(service))
    assert outcome(system, context, run) == undisturbed[0]


def test_a_run_survives_a_schedule_of_faults_that_kill_nothing(
    undisturbed: tuple[Outcome, set[int]], system: System, context: Context
) -> None:
    """`make chaos` draws many, with all faults."""
    names = ("freeze worker", "empty broker", "hang broker", "lock database", STORM)
    faults = [Happened(name, share) for name, share in zip(names, (0.1, 0.2, 0.4, 0.5, 0.6), strict=True)]
    settings, run = system.supervisor.settings, system.submit(DOCUMENT)
    target = Target(system, run, context.engine, None, Path(settings.artifacts_url), settings.data_dir / "clock")
    chaos = schedule.Outcome("sqlite", 1, settings.data_dir, faults=faults)
    schedule.disturb(target, chaos)
    assert not chaos.violations
    assert all(fault.ended for fault in faults)
    assert outcome(system, context, run) == undisturbed[0]


STUDY = spec(vary=[["person-1.pos.x", "UNIFORM", -3, 3], ["person-1.pos.y", "UNIFORM", 3, 9]]) | {
    "measure": "min(pacc) >= 0.5",
    "goal": {"name": "find", "repeats": 0},
    "budget": {"variants": 96},
    "batch": 8,
}


def pursue(system: System, context: Context, killed: Iterator[str]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Pursue the study to its end, and kill the next service whenever another batch is in work; its products are freed.

    Returns:
        Its batches and its result, without ids, times and costs.
    """
    study = system.begin(STUDY)
    pids: set[int] = set()
    deadline = time.monotonic() + 400
    while (known := system.study(study))["state"] == "running":
        assert time.monotonic() < deadline, known
        working = {b["number"] for b in known["batches"] if b["run_id"] and b["outcomes"] is None}
        if working - pids and (service := next(killed, None)) is not None:
            kill(system.processes(service))
        pids |= working
        time.sleep(0.2)
    assert known["state"] == "finished", known["reason"]
    batches = known["batches"]
    for batch in batches:
        if batch["run_id"]:
            system.client.delete(f"/v1/runs/{batch['run_id']}").raise_for_status()
    gc.collect(context)
    assert not system.objects(), "the next run makes every product again"
    own = ("run_id", "accepted_at", "cpu_seconds")
    return [{k: v for k, v in batch.items() if k not in own} for batch in batches], known["result"]


def test_a_study_survives_kill_9_of_every_service_and_decides_what_the_calm_one_does(
    system: System, context: Context
) -> None:
    calm = pursue(system, context, iter(()))
    services = ["render", "infer", "eval", "api", "redis"]
    left = iter(services)
    before = system.supervisor.pids()
    assert pursue(system, context, left) == calm
    assert next(left, None) is None, "every service was killed"
    after = system.supervisor.pids()
    assert all(after[service] != before[service] for service in services)
    assert len(calm[0]) > len(services)


def test_messages_delivered_twice_change_nothing(
    undisturbed: tuple[Outcome, set[int]], system: System, context: Context
) -> None:
    run = begin(system, context)
    with reading(context.engine) as connection:
        columns = (Product.digest, Product.kind, Product.route, Product.cache_group, Product.turn)
        everything = [Ready(*row) for row in connection.execute(select(*columns).where(Product.route != ""))]
    context.broker.send_products(everything)
    assert outcome(system, context, run) == undisturbed[0]
