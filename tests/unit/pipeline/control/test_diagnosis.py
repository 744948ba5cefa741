"""`valerie doctor`: each fault is named, with what to do."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import delete, update

from tests.world.blank import SMALL, Pipeline
from valerie.db import processes
from valerie.db.engine import database_time, writing
from valerie.db.models import Product, Worker
from valerie.pipeline.control.diagnosis import diagnose
from valerie.runs.products.ready import Fault
from valerie.runs.products.states import ProductKind, ProductState


def problems(pipeline: Pipeline) -> dict[str, str]:
    return {check.part: check.problem for check in diagnose(pipeline.context) if check.problem}


def test_nothing_is_wrong_with_a_deployment_that_works(pipeline: Pipeline) -> None:
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    checks = diagnose(pipeline.context)
    assert [check.problem for check in checks if check.problem] == []
    states = {check.part: check.state for check in checks}
    assert {"settings", "database", "broker", "artifacts", "control loop", "runs"} <= states.keys()
    assert {state.split(", ")[0] for part, state in states.items() if part.startswith("queue")} == {"1 worker"}
    assert states["runs"] == "0 at work, 0 unfinished products"


def test_a_broker_that_is_away_is_named_beside_all_else(pipeline: Pipeline) -> None:
    pipeline.loop.tick(everything=True)
    pipeline.broker.down = True
    assert problems(pipeline) == {"broker": "the broker does not answer"}


def test_a_deployment_without_a_control_loop_is_told_to_start_one(pipeline: Pipeline) -> None:
    assert problems(pipeline) == {"control loop": "no process has this role"}


def test_a_folder_without_a_server_is_wrong_only_while_work_waits_for_one(pipeline: Pipeline) -> None:
    pipeline.broker.down = True
    checks = diagnose(pipeline.context, serverless=True)
    assert [check.problem for check in checks if check.problem] == []
    assert [check.state for check in checks if check.part == "server"] == ["none runs, and no work waits for one"]
    run = pipeline.submit(SMALL)
    found = {check.part: check.problem for check in diagnose(pipeline.context, serverless=True)}
    assert found["server"] == f"none runs, and work waits for one: run {run}"


def test_a_queue_that_nobody_serves_is_named(pipeline: Pipeline) -> None:
    pipeline.submit(SMALL)
    pipeline.loop.tick(everything=True)
    with writing(pipeline.context.engine) as connection:
        connection.execute(delete(Worker))
    (name,) = [part for part in problems(pipeline) if part.startswith("queue render.blank")]
    assert "no worker serves this queue" in problems(pipeline)[name]


def test_a_worker_that_was_put_aside_is_named_with_its_reason_until_it_works_again(pipeline: Pipeline) -> None:
    pipeline.loop.tick(everything=True)
    with writing(pipeline.context.engine) as connection:
        (worker,) = processes.workers(connection, now=database_time(connection))
        processes.rest(connection, worker.id, "no driver opens the card")
    found = problems(pipeline)
    assert "no driver opens the card" in found[f"worker {worker.id}"]
    assert worker.host in found[f"worker {worker.id}"]
    with writing(pipeline.context.engine) as connection:
        processes.rest(connection, worker.id, None)
    assert f"worker {worker.id}" not in problems(pipeline)


def test_a_worker_whose_clock_is_off_is_named_with_what_that_means(pipeline: Pipeline) -> None:
    pipeline.loop.tick(everything=True)
    found = {}
    for ahead in (4.0, -4.0, 7200.0, -90.0):
        with writing(pipeline.context.engine) as connection:
            now = database_time(connection)
            (worker,) = processes.workers(connection, now=now)
            processes.worker_seen(connection, worker.id, now, ahead)
        found[ahead] = problems(pipeline)
    assert found[4.0] == found[-4.0] == {}
    part = f"clock of {worker.id}"
    for ahead, words in ((7200.0, "7,200 s ahead of"), (-90.0, "90 s behind")):
        assert found[ahead].keys() == {part}
        expected = f"the clock of {worker.host} is {words} the database's: results are right, but times in its log"
        assert found[ahead][part].startswith(expected)
    (check,) = (check for check in diagnose(pipeline.context) if check.part == part)
    assert "NTP" in check.remedy


def test_a_worker_of_an_older_release_has_an_unknown_clock(pipeline: Pipeline) -> None:
    pipeline.loop.tick(everything=True)  # its row does not say
    assert problems(pipeline) == {}


def test_products_that_failed_for_good_are_named_with_their_reason(pipeline: Pipeline) -> None:
    run = pipeline.submit(SMALL)
    assert pipeline.run(run) == "completed"
    fault = Fault(stage="layer", type="RenderingError", message="the driver is broken", attempts=2)
    with writing(pipeline.context.engine) as connection:
        layers = update(Product.__table__).where(Product.kind == ProductKind.LAYER)  # type: ignore[arg-type]
        connection.execute(layers.values(state=ProductState.FAILED, error=fault))
    assert "RenderingError: the driver is broken" in problems(pipeline)["failed layer"]


def test_a_run_that_waits_says_for_what(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(workers=False)
    run = pipeline.submit(SMALL)
    pipeline.loop.tick(everything=True)
    assert "waiting for a render worker" in problems(pipeline)[f"run {run}"]


def test_too_little_space_is_named(pipelines: Callable[..., Pipeline]) -> None:
    pipeline = pipelines(min_free_mb=10**9)
    pipeline.loop.tick(everything=True)
    assert "runs pause below" in problems(pipeline)["artifacts"]
