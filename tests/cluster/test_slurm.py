"""Workers as jobs of a real Slurm, with Postgres and without a broker."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.acceptance.system import System
from tests.cluster.conftest import DOCUMENT, Outcome
from tests.cluster.slurm import slurm
from valerie.settings import NO_BROKER

pytestmark = [pytest.mark.processes, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    with slurm(tmp_path_factory.mktemp("slurm")) as environment:
        yield environment


def test_a_run_by_jobs_of_slurm_ends_as_one_through_redis(
    cluster: dict[str, str], new_database: Callable[[], str], assets: Path, tmp_path: Path, calm: Outcome
) -> None:
    with System(tmp_path, assets, database_url=new_database(), broker_url=NO_BROKER) as system:
        run = system.submit(DOCUMENT)
        command = [sys.executable, "-m", "valerie", "slurm", "submit", "--render", "2", "--idle", "20"]
        environment = {**cluster, **system.settings.environment()}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        stages = [line.split("\t")[0] for line in done.stdout.splitlines()]
        assert stages == ["render", "infer", "eval"]
        assert system.wait(run) == "completed", system.progress(run)
        assert (system.rows(run), system.objects()) == calm
        deadline = time.monotonic() + 90
        while subprocess.run(["squeue", "--noheader"], env=cluster, capture_output=True, check=True).stdout:
            assert time.monotonic() < deadline, "the jobs do not end by themselves"
            time.sleep(0.5)
