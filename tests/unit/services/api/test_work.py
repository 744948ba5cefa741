"""The endpoints about workers, the cost and failures of products, and the descent of runs."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import httpx
from sqlalchemy import select, update

from services.api.app import create_app
from tests.world.drawn import CLASS, DrawnRuns, DrawnWorld, spec
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.db import processes
from valerie.db.engine import database_time, reading, writing
from valerie.db.models import Product
from valerie.pipeline.control.submit import submit
from valerie.runs.products.states import ProductState
from valerie.runs.resolving.spec import parse


def test_a_worker_shows_what_its_child_makes(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    world.work(spec("n"), products=1)
    with writing(world.context.engine) as connection:
        ready = select(Product.digest).where(Product.state == ProductState.READY).limit(2)
        connection.execute(
            update(Product)
            .where(Product.digest.in_(ready))
            .values(state=ProductState.RUNNING, lease_owner="drawn-render.1f2e", lease_until=2e9)
        )
    with reading(world.context.engine) as connection:
        held = connection.scalars(select(Product.kind).where(Product.state == ProductState.RUNNING)).all()
    with served(create_app(settings_of(tmp_path), control=False)) as client:
        makes = {one["id"]: one["makes"] for one in client.get("/v1/workers").json()}
    assert makes == {"drawn-render": dict(Counter(held)), "drawn-infer": {}, "drawn-eval": {}}


def test_a_worker_shows_how_far_its_clock_is_off(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    with writing(world.context.engine) as connection:
        processes.worker_seen(connection, "drawn-infer", database_time(connection), -7200.0)
    with served(create_app(settings_of(tmp_path), control=False)) as client:
        clocks = {one["id"]: one["clock"] for one in client.get("/v1/workers").json()}
    assert clocks.pop("drawn-infer").startswith("7,200 s behind the database's: results are right, but ")
    assert clocks == {"drawn-render": None, "drawn-eval": None}


def test_costs_are_the_means_of_the_products_of_each_span(fresh: httpx.Client, tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path / "data"))
    with writing(world.context.engine) as connection:
        now = int(database_time(connection))
        digests = list(connection.scalars(select(Product.digest).where(Product.kind == "layer").limit(3)))
        connection.execute(update(Product).values(finished_at=now - 3 * 3600))
        for digest, age, seconds in zip(digests, (90, 95, 1800), (1.0, 2.0, 5.0), strict=True):
            done = {"state": ProductState.DONE, "finished_at": now - age, "cpu_seconds": seconds}
            connection.execute(update(Product).where(Product.digest == digest).values(done))
    work = fresh.get("/v1/work", params={"hours": 1}).json()
    (layers,) = work["costs"]
    assert (layers["kind"], sum(layers["products"])) == ("layer", 3)
    spent = [n * mean for n, mean in zip(layers["products"], layers["cpu_seconds"], strict=True) if n]
    assert sum(spent) == 8.0
    assert spent[0] == 5.0, "the older one"
    assert work["span_s"] == 60


def test_rates_count_the_last_two_minutes(fresh: httpx.Client, tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path / "data"))
    with writing(world.context.engine) as connection:
        now = database_time(connection)
        connection.execute(update(Product).values(finished_at=now - 600))
        layers = select(Product.digest).where(Product.kind == "layer", Product.state == ProductState.DONE).limit(6)
        connection.execute(update(Product).where(Product.digest.in_(layers)).values(finished_at=now - 20))
    rates = {one["route"]: one["per_minute"] for one in fresh.get("/v1/queues").json()}
    assert rates.pop(f"render.raster.{CLASS}") == 3.0
    assert set(rates.values()) == {0.0}


def test_failures_are_counted_by_reason_without_those_that_follow(api: httpx.Client, drawn: DrawnRuns) -> None:
    (reason,) = api.get("/v1/work").json()["failures"]
    roots = [one for one in api.get(f"/v1/runs/{drawn.failed}/failures").json() if "cause" not in one["error"]]
    assert (reason["kind"], reason["type"], reason["products"]) == ("layer", "RenderingError", len(roots))
    assert "constant" in reason["message"]


def test_the_lineage_has_ancestors_siblings_and_descendants_and_nothing_else(fresh: httpx.Client) -> None:
    def child(parent: str | None, name: str) -> str:
        document = spec(name, **({"parent_run": parent, "iteration": 1} if parent else {}))
        return str(fresh.post("/v1/runs", json=document).json()["id"])

    root = child(None, "root")
    left, right = child(root, "left"), child(root, "right")
    grandchild = child(left, "grandchild")
    other = child(None, "other")
    for run in (root, left, right, grandchild):
        lineage = fresh.get(f"/v1/runs/{run}/lineage").json()
        assert {node["id"]: node["parent_run"] for node in lineage} == {
            root: None,
            left: root,
            right: root,
            grandchild: left,
        }
    assert [one["id"] for one in fresh.get(f"/v1/runs/{other}/lineage").json()] == [other]


def test_a_child_whose_parent_was_deleted_is_a_root(fresh: httpx.Client, drawn: DrawnRuns) -> None:
    child = fresh.post("/v1/runs", json=spec("child", parent_run=drawn.finished)).json()["id"]
    assert fresh.delete(f"/v1/runs/{drawn.finished}").status_code == 204
    assert [one["parent_run"] for one in fresh.get(f"/v1/runs/{child}/lineage").json()] == [None]


def test_demand_counts_products_to_make_and_runs_that_wait_for_workers(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    world.work(spec("n"), products=1)
    submit(world.context, parse({**spec("later"), "renderer": "cycles"}))
    with reading(world.context.engine) as connection:
        states = connection.execute(select(Product.route, Product.state)).all()
    to_make = Counter(".".join(route.split(".")[:2]) for route, state in states if state in ("ready", "running"))
    with served(create_app(settings_of(tmp_path), control=False)) as client:
        demand = client.get("/v1/demand").json()
    assert to_make["render.raster"] > 0 < to_make["render.truth"]
    assert demand == {
        "render": {"raster": to_make["render.raster"], "pyrender": 0, "cycles": 1, "truth": to_make["render.truth"]},
        "infer": sum(count for route, count in to_make.items() if route.startswith("infer")) + 1,
        "eval": to_make["eval"],
    }
