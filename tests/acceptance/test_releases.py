"""Two releases at once: while workers of one run, a server of the next one migrates the database and works on with its own.

With ``VALERIE_TEST_RELEASE=v0.1.0`` (a commit or tag), the older release is that one, and the newer one is this tree. By
default, the older one is this tree, and the newer one has a further migration (`tests.world.releases.next_release`).
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from tests.acceptance.system import Api, System
from tests.world.boxes import spec, write_box_street
from tests.world.postgres import PostgresServer
from tests.world.releases import ROOT, called, kill_all, next_release, past_release, running, workers_of
from valerie.db.engine import open_database, reading
from valerie.embedded import redis_server
from valerie.embedded.supervisor import WORKERS, free_port
from valerie.settings import Settings, load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(480)]

DOCUMENT = spec(xs=10, ys=8)
PAST = os.environ.get("VALERIE_TEST_RELEASE", "")


@pytest.fixture(scope="module")
def releases(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folders of the older and the newer release."""
    folder = tmp_path_factory.mktemp("release") / "other"
    return (past_release(PAST, folder), ROOT) if PAST else (ROOT, next_release(folder))


@contextmanager
def deployment() -> Iterator[Settings]:
    """Start Postgres and Redis; yield the settings of everything else."""
    with tempfile.TemporaryDirectory(prefix="valerie-releases-") as name:
        folder, socket = Path(name), Path(name) / "redis.sock"
        folder.chmod(0o755)  # Postgres may run as another user
        write_box_street(folder / "assets" / "box-street")
        (folder / "postgres").mkdir()
        server = PostgresServer(folder / "postgres")
        settings = load_settings(
            {},
            data_dir=folder / "data",
            asset_dir=folder / "assets",
            database_url=server.url("postgres"),
            broker_url=redis_server.server_url(socket),
            api_port=0,
            testing_engines=True,
            render_engines="blank",
            infer_functions="blank",
            lease_seconds=3.0,
            heartbeat_seconds=0.5,
            sweep_seconds=0.5,
            resend_seconds=3.0,
            min_free_mb=0,
        )
        settings = settings.model_copy(update={"api_port": free_port(settings)})
        command = redis_server.server_command(redis_server.find_server(settings), socket, folder)
        with server, subprocess.Popen(command, stdout=subprocess.DEVNULL) as redis:
            try:
                redis_server.wait_until_it_answers(socket, seconds=30)
                yield settings
            finally:
                redis.kill()


@contextmanager
def served(release: Path, settings: Settings) -> Iterator[Api]:
    """Start the API of a release, which migrates the database."""
    url = f"http://127.0.0.1:{settings.api_port}"
    with running(release, settings, {"api": "services.api"}), httpx.Client(base_url=url, timeout=30.0) as client:
        deadline = time.monotonic() + 60
        while True:
            try:
                client.get("/healthz").raise_for_status()
                break
            except httpx.HTTPError:
                assert time.monotonic() < deadline, "the API did not start"
                time.sleep(0.1)
        yield Api(client)


def revision(settings: Settings) -> str:
    engine = open_database(settings.database_url)
    try:
        with reading(engine) as connection:
            return str(connection.scalar(text("SELECT version_num FROM alembic_version")))
    finally:
        engine.dispose()


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return the rows of the run by this release alone."""
    folder = tmp_path_factory.mktemp("calm")
    write_box_street(folder / "assets" / "box-street")
    with System(folder / "data", folder / "assets") as system:
        run = system.submit(DOCUMENT)
        assert system.wait(run) == "completed"
        return system.rows(run)


def test_workers_of_the_older_release_go_on_beside_the_newer_server(
    releases: tuple[Path, Path], calm: list[dict[str, Any]]
) -> None:
    older, newer = releases
    with deployment() as settings:
        assert called(older, settings, "services.api", "--migrate-only").returncode == 0
        before = revision(settings)
        with workers_of(older, settings) as old, served(newer, settings) as api:
            after = revision(settings)
            with workers_of(newer, settings) as new:
                trees = [part for process in new for part in (process, *process.children(recursive=True))]
                for process in trees:
                    process.suspend()
                run = api.submit(DOCUMENT)
                # Only the older workers work.
                api.wait(run, until=lambda progress: progress["stages"].get("eval", {}).get("done", 0) > len(calm) / 4)
                for process in trees:
                    process.resume()
                kill_all(old)
                assert api.wait(run) == "completed", api.progress(run)
                assert api.rows(run) == calm
        if before != after:
            refused = called(older, settings, WORKERS["render"])
            assert refused.returncode != 0
            assert "it was written by a newer one; install that version" in refused.stderr, refused.stderr


def test_a_worker_of_the_newer_release_leaves_the_database_of_an_older_server_as_it_is(
    releases: tuple[Path, Path], calm: list[dict[str, Any]]
) -> None:
    older, newer = releases
    with deployment() as settings, served(older, settings) as api, workers_of(older, settings):
        before = revision(settings)
        run = api.submit(DOCUMENT)
        refused = called(newer, settings, WORKERS["render"])
        assert refused.returncode != 0
        assert "run `valerie migrate`" in refused.stderr, refused.stderr
        assert api.wait(run) == "completed", api.progress(run)
        assert api.rows(run) == calm
        assert revision(settings) == before


def test_an_upgrade_and_the_way_back_keep_all_rows(
    releases: tuple[Path, Path], calm: list[dict[str, Any]], tmp_path: Path
) -> None:
    older, newer = releases
    backup = str(tmp_path / "backup")
    with deployment() as settings:
        with served(older, settings) as api, workers_of(older, settings):
            run = api.submit(DOCUMENT)
            assert api.wait(run) == "completed", api.progress(run)
        saved = called(older, settings, "valerie", "backup", backup, "--products")
        assert saved.returncode == 0, saved.stderr
        with served(newer, settings) as api, workers_of(newer, settings):
            assert api.rows(run) == calm
            again = api.submit(DOCUMENT)
            assert api.wait(again) == "completed", api.progress(again)
            assert api.rows(again) == calm
    with deployment() as settings:
        restored = called(older, settings, "valerie", "restore", backup)
        assert restored.returncode == 0, restored.stderr
        with served(older, settings) as api:
            assert api.rows(run) == calm
