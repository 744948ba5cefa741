"""The API while a table of Postgres is locked: each answer comes in time and says what is unknown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest
from sqlalchemy import Engine, text

from services.api.app import create_app
from tests.world.drawn import DrawnRuns, draw_runs
from tests.world.serving import served
from tests.world.world import settings_of
from valerie.db.engine import open_database

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]

#: Far more than the bounds, far less than a lock may last.
PATIENCE = 40.0


class World(NamedTuple):
    runs: DrawnRuns
    client: httpx.Client
    engine: Engine


@pytest.fixture(scope="module")
def world(new_database: Callable[[], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    folder: Path = tmp_path_factory.mktemp("locked")
    settings = settings_of(folder, database_url=new_database())
    runs = draw_runs(settings)
    engine = open_database(settings.database_url)
    with served(create_app(settings, control=False)) as client:
        client.timeout = httpx.Timeout(PATIENCE)
        yield World(runs, client, engine)
    engine.dispose()


@contextmanager
def locked(engine: Engine, *tables: str) -> Iterator[None]:
    with engine.begin() as connection:
        connection.execute(text(f"LOCK TABLE {', '.join(tables)} IN ACCESS EXCLUSIVE MODE"))
        yield


def test_a_page_of_frames_is_refused_in_time_and_given_later(world: World) -> None:
    path = f"/v1/runs/{world.runs.finished}/frames"
    before = world.client.get(path).json()
    with locked(world.engine, "products", "frames"):
        answer = world.client.get(path)
    assert answer.status_code == 503
    assert "lock timeout" in answer.json()["detail"]
    assert int(answer.headers["retry-after"]) > 0
    assert world.client.get(path).json() == before


def test_more_requests_than_connections_are_refused_in_time(world: World) -> None:
    path = f"/v1/runs/{world.runs.finished}/frames"
    with locked(world.engine, "frames"), ThreadPoolExecutor(30) as executor:
        answers = list(executor.map(world.client.get, [path] * 30))
    assert {answer.status_code for answer in answers} == {503}


def test_metrics_and_queues_say_what_is_unknown(world: World) -> None:
    with locked(world.engine, "products"):
        metrics, queues = world.client.get("/metrics"), world.client.get("/v1/queues")
    assert metrics.status_code == queues.status_code == 200
    lines = metrics.text.splitlines()
    assert {'valerie_up{part="database"} 0.0', 'valerie_unknown{metrics="products"} 1.0'} <= set(lines)
    assert {'valerie_unknown{metrics="runs"} 0.0', 'valerie_unknown{metrics="workers"} 0.0'} <= set(lines)
    assert any(line.startswith("valerie_runs{") for line in lines)
    assert not any(line.startswith("valerie_products{") for line in lines)
    evaluating = {queue["route"]: queue for queue in queues.json()}["eval"]
    assert evaluating["workers"] >= 1
    assert {evaluating[name] for name in ("waiting", "ready", "running", "per_minute")} == {None}


def test_queues_are_refused_when_nothing_of_them_is_known(world: World) -> None:
    with locked(world.engine, "products", "workers"):
        queues, metrics = world.client.get("/v1/queues"), world.client.get("/metrics")
    assert queues.status_code == 503
    assert 'valerie_unknown{metrics="workers"} 1.0' in metrics.text
    assert world.client.get("/v1/queues").status_code == 200
