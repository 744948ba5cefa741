"""The API over Postgres and Redis gives clients the same answers as over SQLite."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pyarrow.parquet as pq
import pytest
import structlog

from services.api.app import create_app
from tests.world.drawn import DrawnRuns, draw_runs, spec
from tests.world.serving import every_item, served
from tests.world.world import settings_of
from valerie.logs import configure_logging

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


@dataclass(frozen=True)
class Deployment(DrawnRuns):
    """A served database with the drawn runs."""

    client: httpx.Client


@pytest.fixture(scope="module", autouse=True)
def _logs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    configure_logging(settings_of(tmp_path_factory.mktemp("logs"), log_level="error"))
    yield
    structlog.reset_defaults()


@pytest.fixture(scope="module")
def deployment(
    new_database: Callable[[], str], redis_url: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Deployment]:
    folder = tmp_path_factory.mktemp("postgres")
    settings = settings_of(folder, database_url=new_database(), broker_url=redis_url)
    runs = draw_runs(settings)
    with served(create_app(settings, control=False)) as client:
        yield Deployment(**vars(runs), client=client)


def table(deployment: Deployment) -> list[dict[str, Any]]:
    path = f"/v1/runs/{deployment.finished}/evaluations"
    data = deployment.client.get(path, params={"format": "parquet"}).content
    rows: list[dict[str, Any]] = pq.read_table(io.BytesIO(data)).to_pylist()
    return rows


def walk(deployment: Deployment, **parameters: Any) -> list[dict[str, Any]]:
    return every_item(deployment.client, f"/v1/runs/{deployment.finished}/evaluations", limit=23, **parameters)


def test_database_broker_and_store_answer(deployment: Deployment) -> None:
    checks = deployment.client.get("/readyz").json()
    assert checks == {"status": "ok", "checks": {"database": "ok", "broker": "ok", "artifacts": "ok"}}


def test_without_a_broker_the_server_is_not_ready_and_says_why(new_database: Callable[[], str], tmp_path: Path) -> None:
    with served(create_app(settings_of(tmp_path, database_url=new_database()), control=False)) as client:
        answer = client.get("/readyz")
        assert answer.status_code == 503
        assert "does not answer" in answer.json()["checks"]["broker"]
        assert answer.json()["checks"]["database"] == "ok"


@pytest.mark.parametrize("sort", ["pacc", "-pacc", "pixel_area", "-undefined_reason", "camera", "-occlusion_rate"])
def test_sorted_pages_are_the_whole_table(deployment: Deployment, sort: str) -> None:
    rows = walk(deployment, sort=sort)
    assert sorted(map(repr, rows)) == sorted(map(repr, table(deployment)))
    column = sort.removeprefix("-")
    values = [row[column] for row in rows if row[column] is not None]
    assert values == sorted(values, reverse=sort.startswith("-"))


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("pixel_area:gt:2.5", lambda row: row["pixel_area"] is not None and row["pixel_area"] > 2.5),
        ("pixel_area:lt:1e300", lambda row: row["pixel_area"] is not None),
        ("variant_index:eq:4", lambda row: row["variant_index"] == 4),
        ("undefined_reason:ne:absent", lambda row: row["undefined_reason"] not in (None, "absent")),
        ("pacc:null:true", lambda row: row["pacc"] is None),
    ],
)
def test_filters_keep_the_matching_rows(deployment: Deployment, text: str, holds: Any) -> None:
    assert walk(deployment, filter=text) == [row for row in table(deployment) if holds(row)]


def test_points_and_neighbours_are_found(deployment: Deployment) -> None:
    points = deployment.client.get(f"/v1/runs/{deployment.finished}/points", params={"limit": 100}).json()
    assert 0 < len(points["x"]) < len(table(deployment))
    frames = [item["id"] for item in deployment.client.get(f"/v1/runs/{deployment.finished}/frames").json()["items"]]
    first = deployment.client.get(f"/v1/frames/{frames[0]}").json()
    assert (first["previous"], first["next"]) == (None, frames[1])


def test_a_key_that_is_used_concurrently_makes_one_run(deployment: Deployment) -> None:
    def post(_: int) -> httpx.Response:
        return deployment.client.post("/v1/runs", json=spec("at once"), headers={"Idempotency-Key": "at-once"})

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(post, range(8)))
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1


def test_a_run_is_cancelled_and_resumed_and_its_products_are_sent(deployment: Deployment) -> None:
    client, path = deployment.client, f"/v1/runs/{deployment.running}"
    assert client.post(f"{path}/cancel").json()["state"] == "cancelled"
    assert client.post(f"{path}/resume").json()["state"] == "running"
    assert client.post(f"{path}/resume").status_code == 409


def test_a_retry_sends_messages_that_the_queues_count(deployment: Deployment) -> None:
    client = deployment.client
    assert client.post(f"/v1/runs/{deployment.failed}/retry").status_code == 200
    queues = {one["route"]: one for one in client.get("/v1/queues").json()}
    raster = next(one for route, one in queues.items() if route.startswith("render.raster"))
    assert raster["messages"] >= 1
    text = client.get("/metrics").text
    assert f'valerie_queue_messages{{route="{raster["route"]}"}} {float(raster["messages"])}' in text
    assert 'valerie_products_done_total{kind="evaluation"}' in text


def test_a_deleted_run_is_gone(deployment: Deployment) -> None:
    run = deployment.client.post("/v1/runs", json=spec("short-lived")).json()["id"]
    deployment.client.post(f"/v1/runs/{run}/cancel")
    assert deployment.client.delete(f"/v1/runs/{run}").status_code == 204
    assert deployment.client.get(f"/v1/runs/{run}").status_code == 404


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"VALERIE_API_HOST": "0.0.0.0"}, "open to the network without a token"),
        ({"VALERIE_API_HOST": "0.0.0.0", "VALERIE_API_TOKEN": "short"}, "at least 16 characters"),
        ({"VALERIE_ARTIFACTS_URL": "/proc/artifacts"}, "/proc/artifacts"),
        ({"VALERIE_DATABASE_URL": "mysql://x"}, "sqlite or postgresql"),
    ],
)
def test_a_server_that_cannot_start_says_why_in_one_line(tmp_path: Path, changes: dict[str, str], said: str) -> None:
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), "VALERIE_DATA_DIR": str(tmp_path), **changes}
    done = subprocess.run(
        [sys.executable, "-m", "services.api"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
