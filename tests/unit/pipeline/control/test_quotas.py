"""Quotas of owners: what counts, and that no way leads around them. The operator has none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from datetime import timedelta
from threading import Event

import pytest
from sqlalchemy import select

from tests.world.blank import SMALL, Pipeline
from tests.world.boxes import spec
from valerie.db import runs, usage
from valerie.db.engine import database_time, reading
from valerie.db.models import Product
from valerie.errors import Conflict, QuotaExceeded, StorageFull
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.pipeline.control import lifecycle, quotas
from valerie.pipeline.control.gc import collect
from valerie.pipeline.control.planning import plan_run
from valerie.runs.forecasting.costs import Cost
from valerie.runs.products.states import ProductState
from valerie.runs.resolving.spec import parse

Make = Callable[..., Pipeline]
#: Shares no product with `SMALL`, and costs the same.
ANOTHER = spec(xs=4, ys=3, constants={"sun-1.azimuth": 77.0})


def end(pipeline: Pipeline) -> None:
    """End the control loop, so that another one takes its role at once."""
    stop = Event()
    stop.set()
    pipeline.loop.run(stop)


def test_a_run_too_many_is_refused_with_quota_value_and_limit(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=2)
    for _ in range(2):
        pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="Eve would have 3 unfinished runs; limit: 2"):
        pipeline.submit(owner="Eve")
    pipeline.submit(owner="Ada")
    for _ in range(3):
        pipeline.submit()


def test_variants_of_unfinished_runs_are_counted_before_any_is_written(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_variants=20)
    pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="Eve would have 24 variants in unfinished runs; limit: 20"):
        pipeline.submit(owner="Eve")
    assert pipeline.row(pipeline.submit(owner="Ada")).next_index == 0


def test_a_finished_run_makes_room(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=1)
    assert pipeline.run(pipeline.submit(owner="Eve")) == "completed"
    pipeline.submit(owner="Eve")


@pytest.mark.parametrize("again", [lifecycle.resume, lifecycle.retry])
def test_a_cancelled_run_makes_room_but_cannot_come_back_beside_its_successor(
    pipelines: Make, again: Callable[..., None]
) -> None:
    pipeline = pipelines(max_owner_runs=1)
    first = pipeline.submit(owner="Eve")
    lifecycle.cancel(pipeline.context, first)
    second = pipeline.submit(owner="Eve")
    with pytest.raises(Conflict, match="2 unfinished runs; limit: 1"):
        again(pipeline.context, first)
    assert pipeline.state(first) == "cancelled"
    lifecycle.cancel(pipeline.context, second)
    again(pipeline.context, first)
    assert pipeline.run(first) == "completed"


def test_what_runs_took_and_store_leaves_no_room_for_another(pipelines: Make) -> None:
    """Equal runs of both owners share their products, which count for each in full and once."""
    pipeline = pipelines()
    first, again = (pipeline.submit(owner="Eve") for _ in range(2))
    assert pipeline.run(first) == pipeline.run(again) == pipeline.run(pipeline.submit(owner="Ada")) == "completed"
    with reading(pipeline.context.engine) as connection:
        made = usage.made(connection, owner="Eve")
        assert made == usage.made(connection, owner="Ada") == usage.made(connection)
        linked = runs.linked_digests(connection, first, list(ProductState))
        sizes = {digest: size for digest, size in connection.execute(select(Product.digest, Product.bytes))}  # noqa: C416  # mypy reads the types of rows
        seconds = sum(runs.cpu_seconds(connection, again).values())
        later = database_time(connection) + 1
        assert usage.made(connection, owner="Eve", since=later) == (0.0, made.bytes)
    assert made.cpu_seconds == pytest.approx(seconds)
    assert made.bytes == sum(sizes[digest] or 0 for digest in linked) > 0

    hours, gigabytes = made.cpu_seconds / 3600, made.bytes / 1e9
    took = pipelines(max_owner_cpu_hours=hours)
    with pytest.raises(Conflict, match=r"runs of Eve took \S+ CPU hours in 30 days; limit: "):
        took.submit(owner="Eve")
    pipelines(max_owner_cpu_hours=2 * hours).submit(owner="Eve")
    full = pipelines(max_owner_gigabytes=gigabytes)
    with pytest.raises(Conflict, match=r"runs of Ada store \S+ GB; limit: .*delete runs"):
        full.submit(owner="Ada")
    full.submit()
    full.submit(owner="Joe")


def test_pictures_that_a_run_no_longer_keeps_are_not_stored(pipeline: Pipeline) -> None:
    pipeline.run(pipeline.submit({**SMALL, "retention": "numbers"}, owner="Eve"))
    made = [product for product in pipeline.products() if product.kind != "statics"]
    with reading(pipeline.context.engine) as connection:
        cpu_seconds, size = usage.made(connection, owner="Eve")
    assert cpu_seconds == pytest.approx(sum(product.cpu_seconds for product in made))
    assert size == sum(product.bytes for product in made if product.state == "done")
    assert {product.state for product in made} == {"done", "parked"}


@pytest.fixture
def measured(pipelines: Make) -> tuple[Cost, Make]:
    """What the planner takes for `ANOTHER` from the costs that a run recorded, and pipelines that know these."""
    pipeline = pipelines()
    pipeline.run(pipeline.submit())
    end(pipeline)
    plan = plan_run(pipeline.context, parse(ANOTHER))
    cpu_seconds, size = plan.known_cost
    assert cpu_seconds == sum(product.cpu_seconds for product in plan.products) > 0
    assert size == sum(product.bytes for product in plan.products) > 0
    return plan.known_cost, pipelines


def test_a_run_that_is_forecast_to_exceed_a_quota_is_refused_with_all_that_counts(measured: tuple[Cost, Make]) -> None:
    forecast, pipelines = measured
    hours, gigabytes = forecast.cpu_seconds / 3600, forecast.bytes / 1e9
    scarce = pipelines(max_owner_cpu_hours=1.5 * hours)
    run = scarce.submit(ANOTHER, owner="Eve")
    assert scarce.row(run).forecast == pytest.approx(forecast)
    parts = r"0 taken, \S+ forecast for unfinished runs, \S+ for this one; limit: "
    with pytest.raises(QuotaExceeded, match=r"runs of Eve would take \S+ CPU hours in 30 days: " + parts):
        scarce.submit({**ANOTHER, "seed": 1}, owner="Eve")
    scarce.submit(ANOTHER, owner="Ada")
    small = pipelines(max_project_gigabytes=0.9 * gigabytes)
    with pytest.raises(QuotaExceeded, match=r"runs of project radar would store \S+ GB: .* for this one; limit: "):
        small.submit(ANOTHER, owner="Joe", project="radar")
    (warning,) = plan_run(small.context, parse(ANOTHER), owner="Joe", project="radar").warnings[-1:]
    assert warning.startswith("it would be refused: runs of project radar would store")
    small.submit(ANOTHER, owner="Joe")


def test_of_an_unfinished_run_only_the_rest_of_its_forecast_counts(measured: tuple[Cost, Make]) -> None:
    forecast, pipelines = measured
    pipeline = pipelines(max_owner_gigabytes=1)
    run = pipeline.submit(ANOTHER, owner="Eve")

    def ahead() -> float:
        with reading(pipeline.context.engine) as connection:
            (quota,) = quotas.quotas_of(connection, pipeline.settings, "Eve", "")
        return quota.forecast * 1e9

    assert ahead() == pytest.approx(forecast.bytes)
    for _ in range(3):
        pipeline.step(limit=20)
    pipeline.loop.tick(everything=True)
    progress = pipeline.row(run).progress
    assert progress is not None
    ended, total = (sum(getattr(stage, name) for stage in progress.stages.values()) for name in ("done", "total"))
    assert 0 < ended < total
    assert ahead() == pytest.approx(forecast.bytes * (1 - ended / total))
    assert pipeline.run(run) == "completed"
    assert ahead() == 0


def test_a_guessed_cost_refuses_nothing(pipelines: Make) -> None:
    """Nothing is known about the blank engine before its first products; a guess takes the dearest engine."""
    pipeline = pipelines(max_owner_cpu_hours=1e-3)
    plan = plan_run(pipeline.context, parse(SMALL), owner="Eve")
    assert plan.cpu_seconds > 3.6 > plan.known_cost.cpu_seconds
    pipeline.submit(owner="Eve")


def test_a_run_that_takes_more_than_its_forecast_pauses_until_the_quota_is_raised(pipelines: Make) -> None:
    run, other = pipelines().submit(owner="Eve"), pipelines().submit(ANOTHER, owner="Ada")
    pipeline = pipelines(max_owner_cpu_hours=1e-9)
    assert pipeline.run(run, until=["paused"]) == "paused"
    reason = pipeline.row(run).reason or ""
    assert reason.startswith("quota: runs of Eve took ")
    assert reason.endswith(" CPU hours in 30 days; limit: 1e-09")
    assert pipeline.run(other, until=["paused"]) == "paused"
    done = Counter(product.state for product in pipeline.products())
    for _ in range(5):
        pipeline.step()
    assert Counter(product.state for product in pipeline.products())["done"] == done["done"] > 0
    for act in (lifecycle.resume, lifecycle.retry):
        with pytest.raises(QuotaExceeded, match="runs of Eve took"):
            act(pipeline.context, run)
    assert (pipeline.state(run), pipeline.row(run).reason) == ("paused", reason)

    end(pipeline)
    raised = pipelines(max_owner_cpu_hours=1)
    assert raised.run(run) == raised.run(other) == "completed"
    assert {product.state for product in raised.products()} == {"done"}


def test_a_paused_run_goes_on_when_its_quota_is_lifted_altogether(pipelines: Make) -> None:
    run = pipelines().submit(owner="Eve")
    pipeline = pipelines(max_owner_gigabytes=1e-9)
    assert pipeline.run(run, until=["paused"]) == "paused"
    end(pipeline)
    assert pipelines().run(run) == "completed"


def test_a_run_that_was_paused_for_storage_then_waits_for_its_quota(pipelines: Make) -> None:
    run = pipelines().submit(owner="Eve")
    pipeline = pipelines(max_owner_gigabytes=1e-9)
    pipeline.step(limit=2)
    pause_for_storage(pipeline.context, StorageFull("no space left"))
    pipeline.step(limit=0)
    assert (pipeline.row(run).reason or "").startswith("quota: runs of Eve store")


def test_a_paused_run_goes_on_when_the_period_has_passed(pipelines: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    run = pipelines().submit(owner="Eve")
    pipeline = pipelines(max_owner_cpu_hours=1e-9)
    assert pipeline.run(run, until=["paused"]) == "paused"
    monkeypatch.setattr(quotas, "CPU_PERIOD", timedelta(0))
    assert pipeline.run(run) == "completed"


def test_deleting_a_run_makes_room_in_the_store_but_takes_back_no_cpu_time(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_cpu_hours=1)
    first, twin = (pipeline.submit(owner="Eve") for _ in range(2))
    pipeline.run(first)
    pipeline.run(twin)

    def made(*, ahead: float = -1e9) -> Cost:
        with reading(pipeline.context.engine) as connection:
            return usage.made(connection, owner="Eve", since=database_time(connection) + ahead)

    before = made()
    lifecycle.delete(pipeline.context, first)
    assert made() == before
    lifecycle.delete(pipeline.context, twin)
    collect(pipeline.context)
    assert made().cpu_seconds == pytest.approx(before.cpu_seconds)
    assert (made().bytes, made(ahead=1.0)) == (0, (0, 0))
    with reading(pipeline.context.engine) as connection:
        assert usage.made(connection, owner="Ada") == (0, 0)


def test_what_counts_is_listed_for_its_holder_and_for_the_operator(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_variants=100, max_project_gigabytes=2, max_owner_cpu_hours=3)
    pipeline.run(pipeline.submit(owner="Ada"))
    pipeline.submit(owner="Eve", project="radar")
    with reading(pipeline.context.engine) as connection:
        eve = quotas.quotas_of(connection, pipeline.settings, "Eve", "radar")
        ada = quotas.quotas_of(connection, pipeline.settings, "Ada", "")
        everything = quotas.quotas_of(connection, pipeline.settings, None, "")
        cpu_seconds = usage.made(connection, owner="Ada").cpu_seconds
    assert [(each.holder, each.resource, each.used, each.limit) for each in eve] == [
        ("Eve", "variants", 12, 100),
        ("Eve", "cpu-hours", 0, 3),
        ("project radar", "gigabytes", 0, 2),
    ]
    assert [each.used for each in ada] == [0, cpu_seconds / 3600]
    assert everything == [*ada, *eve]


def test_a_repeated_request_is_answered_though_the_quota_is_used_up(pipelines: Make) -> None:
    pipeline = pipelines(max_owner_runs=1)
    first = pipeline.submit(owner="Eve", idempotency_key="once")
    assert pipeline.submit(owner="Eve", idempotency_key="once") == first
    with pytest.raises(Conflict, match="another spec"):
        pipeline.submit({**SMALL, "seed": 7}, owner="Eve", idempotency_key="once")
