"""A worker's processes: the parent that supervises and the child that computes."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import redis

from valerie.broker import Broker
from valerie.db.engine import open_database
from valerie.db.migrate import migrate
from valerie.runs.products.states import EVAL_QUEUE
from valerie.settings import load_settings

pytestmark = [pytest.mark.processes, pytest.mark.timeout(240)]


def _after(seconds: float, parent: psutil.Process) -> list[psutil.Process]:
    """Wait, and return the children of a process."""
    time.sleep(seconds)
    return parent.children()


def test_a_child_in_the_middle_of_a_product_ends_with_its_parent(tmp_path: Path, redis_url: str) -> None:
    settings = load_settings({}, data_dir=tmp_path, broker_url=redis_url)
    migrate(open_database(settings.database_url))
    environment = {"PATH": "/usr/bin:/bin", **settings.environment()}
    client = redis.Redis(unix_socket_path=redis_url.partition("//")[2].partition("?")[0])
    with client, subprocess.Popen([sys.executable, "-m", "services.eval_worker"], env=environment) as worker:
        try:
            parent = psutil.Process(worker.pid)
            Broker(settings).send_finish("of no run")
            deadline = time.monotonic() + 120
            while client.llen(EVAL_QUEUE) or client.hlen("unacked"):
                assert worker.poll() is None
                assert time.monotonic() < deadline
                time.sleep(0.1)
            # A child that starts has not yet asked the kernel to end with its parent; one that waits for work has.
            while not all(child.status() == psutil.STATUS_SLEEPING for _ in range(5) for child in _after(0.2, parent)):
                assert time.monotonic() < deadline
            children = parent.children()
            assert children
            for child in children:
                child.suspend()  # a busy child looks at its pipes no more often
        finally:
            worker.kill()
    _, alive = psutil.wait_procs(children, timeout=30)
    for child in alive:
        child.kill()
    assert not alive
