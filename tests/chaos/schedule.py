"""One schedule: a system of its own, a run, and faults at drawn shares of its products."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import httpx
from sqlalchemy import Engine, func, select

from tests.acceptance.system import System
from tests.chaos.faults import DIALS, FAULTS, FULL_DATA, MOUNTED, STORM, Target, dial_environment, new_dial
from tests.chaos.link import Link
from tests.chaos.watching import Happened, Watcher, contradictions, note_published
from tests.world.boxes import spec, write_box_street
from tests.world.postgres import PostgresServer
from valerie.db.engine import open_database, reading
from valerie.db.models import Product, Worker
from valerie.embedded import redis_server
from valerie.embedded.supervisor import WORKERS, ServiceFailedError
from valerie.runs.products.states import ProductState, RunState

DATABASES = ("sqlite", "postgres")
_DOCUMENT = spec(xs=10, ys=8)
#: Of the run: three for all frames; and a layer, a truth, a prediction and an evaluation for each, behind two cameras.
_PRODUCTS = 3 + 4 * 2 * 10 * 8
#: Shares of the products between which faults begin.
_FIRST, _LAST = 0.02, 0.8
#: A fault begins this long after the one before at the latest, so that some overlap.
_LATEST_SECONDS = 6.0
#: Time in which the run must end after the last fault.
_PATIENCE_SECONDS = 90.0
#: Allowed time without progress beyond the lease: sweeps and a restart. On a busy machine, it is as long as two starts.
_BEYOND_LEASE_SECONDS = 10.0
#: Longest time of a statement.
_DATABASE_SECONDS = 5.0
_ENDED = (RunState.COMPLETED, RunState.COMPLETED_WITH_FAILURES, RunState.FAILED)


@dataclass
class Outcome:
    """The outcome of a schedule.

    Attributes:
        database: one of `DATABASES`.
        seed: of the schedule; 0 is the calm one.
        rows: the long table of the run; None if it did not end.
        faults: in the order in which they began.
        start_seconds: until all processes of the system had started.
        seconds: from the submission to the end.
        retries: number of times that a user had to retry failed products.
        violations: violated invariants.
        folder: data and logs, which stay if something was violated.
        start: stands for the time before the first fault.
    """

    database: str
    seed: int
    folder: Path
    rows: list[dict[str, Any]] | None = None
    faults: list[Happened] = field(default_factory=list)
    start_seconds: float = 0.0
    seconds: float = 0.0
    retries: int = 0
    start: Happened = field(default_factory=lambda: Happened("the start", 0.0))
    violations: list[str] = field(default_factory=list)

    @property
    def standstill(self) -> Happened:
        """The fault with the longest standstill after it."""
        return max([self.start, *self.faults], key=lambda fault: fault.standstill)


def drawn(seed: int, faults: Sequence[str]) -> list[Happened]:
    """Return the faults of a seed; each at most once, since a supervisor gives up a process that ends too often."""
    random = Random(seed)
    names = random.sample(sorted(faults), min(random.randint(3, 6), len(faults)))
    shares = sorted(random.uniform(_FIRST, _LAST) for _ in names)
    return list(map(Happened, names, shares))


def play(database: str, seed: int, faults: Sequence[Happened], calm: Outcome | None) -> Outcome:
    """Run one schedule, and compare it with the calm one.

    Args:
        database: one of `DATABASES`.
        seed: decides how each fault happens.
        faults: what happens.
        calm: outcome without faults; None: this is it.
    """
    outcome = Outcome(database, seed, Path(tempfile.mkdtemp(prefix="valerie-chaos-")), faults=list(faults))
    with _target(database, outcome) as target:
        begun = time.monotonic()
        disturb(target, outcome)
        outcome.seconds = time.monotonic() - begun
        if not outcome.violations:
            outcome.rows = target.system.rows(target.run_id)
        _judge(target, outcome, calm)
    if not outcome.violations:
        shutil.rmtree(outcome.folder)
    return outcome


@contextmanager
def _target(database: str, outcome: Outcome) -> Iterator[Target]:
    """A system that has the run, with what its faults need."""
    names = {fault.name for fault in outcome.faults}
    folder = outcome.folder
    folder.chmod(0o755)  # Postgres may run as another user
    write_box_street(folder / "assets" / "box-street")
    artifacts = folder / "artifacts"
    artifacts.mkdir()
    dials = {name: new_dial(name, folder) for name in DIALS if name in names}
    variables = dial_environment(dials, artifacts)
    with ExitStack() as stack:
        if names & (MOUNTED.keys() - {FULL_DATA}):
            stack.enter_context(_mounted(artifacts, "16m"))
        if FULL_DATA in names:
            (folder / "data").mkdir()
            stack.enter_context(_mounted(folder / "data", "64m"))
        server, links = None, dict[str, Link]()
        settings: dict[str, Any] = {"artifacts_url": str(artifacts), "database_seconds": _DATABASE_SECONDS}
        if database == "postgres":
            (folder / "postgres").mkdir()
            server = stack.enter_context(PostgresServer(folder / "postgres", variables))
            settings["database_url"] = server.url("postgres")
            if any(name.endswith("link to database") for name in names):
                (folder / "link").mkdir(mode=0o755)
                links["database"] = stack.enter_context(Link(folder / "link" / server.socket.name, server.socket))
                settings["database_url"] = server.url("postgres", sockets=folder / "link")
        system = System(folder / "data", folder / "assets", **settings)
        if any(name.endswith("link to broker") for name in names):
            path = redis_server.socket_path(system.settings.data_dir)
            links["broker"] = stack.enter_context(Link(folder / "redis.sock", path))
            url = redis_server.server_url(folder / "redis.sock")
            stack.enter_context(mock.patch.object(redis_server, "server_url", return_value=url))
        begun = time.monotonic()
        with mock.patch.dict(os.environ, variables):
            stack.enter_context(system)
        engine = open_database(server.url("postgres") if server else system.settings.database_url)
        stack.callback(engine.dispose)
        note_published(engine)
        _await_workers(engine)
        outcome.start_seconds = time.monotonic() - begun
        yield Target(system, system.submit(_DOCUMENT), engine, server, artifacts, dials, links)


def _await_workers(engine: Engine) -> None:
    """Wait until every worker has started, which takes longer than the run."""
    deadline = time.monotonic() + _PATIENCE_SECONDS
    while True:
        with reading(engine) as connection:
            if connection.scalar(select(func.count()).select_from(Worker)) == len(WORKERS):
                return
        assert time.monotonic() < deadline, "not every worker has started"
        time.sleep(0.1)


@contextmanager
def _mounted(folder: Path, size: str) -> Iterator[None]:
    """A small file system in memory that can be full or read-only."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size},mode=777", "chaos", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def disturb(target: Target, outcome: Outcome) -> None:
    """Begin each fault when its share of products is done, act as a patient user, and return when the run has ended."""
    waiting, threads = list(outcome.faults), list[threading.Thread]()
    begun = disturbed = acted = time.monotonic()
    with Watcher(str(target.engine.url), target.run_id, outcome.faults) as watcher:
        while True:
            now, state = time.monotonic(), watcher.state
            lasting = {fault.name for fault in outcome.faults if fault.lasts}
            if lasting:
                disturbed = now
            reached = waiting and watcher.done >= waiting[0].share * _PRODUCTS
            overdue = now - begun > (_LATEST_SECONDS if threads else _PATIENCE_SECONDS)
            if waiting and (reached or overdue or state in _ENDED):
                threads.append(_begin(target, outcome, waiting.pop(0)))
                begun = disturbed = now
            elif state == RunState.CANCELLED and STORM not in lasting and now - acted > 1.0:
                acted = now
                _act(target, "resume")
            elif not waiting and not lasting:
                if state == RunState.COMPLETED:
                    break
                if state in _ENDED and now - acted > 1.0:
                    acted = now
                    outcome.retries += _act(target, "retry")
                if now - disturbed > _PATIENCE_SECONDS:
                    outcome.violations.append(f"{_PATIENCE_SECONDS:.0f} s after the last fault the run is {state}")
                    break
            time.sleep(0.02)
    for thread in threads:
        thread.join()
    outcome.start.standstill = watcher.calm_standstill


def _begin(target: Target, outcome: Outcome, fault: Happened) -> threading.Thread:
    def happen() -> None:
        try:
            FAULTS[fault.name](target, Random(f"{outcome.seed} {fault.name}"))
        except Exception as error:
            outcome.violations.append(f"the fault '{fault.name}' could not happen: {error!r}")
        finally:
            fault.ended = time.monotonic()

    fault.began = time.monotonic()
    thread = threading.Thread(target=happen, name=fault.name, daemon=True)
    thread.start()
    return thread


def _act(target: Target, action: str) -> bool:
    """Send a request of the user; return True if it was accepted."""
    with suppress(httpx.TransportError):
        return target.system.client.post(f"/v1/runs/{target.run_id}/{action}").is_success
    return False


def _judge(target: Target, outcome: Outcome, calm: Outcome | None) -> None:
    """Note the violated invariants."""
    with reading(target.engine) as connection:
        counts = connection.execute(select(Product.state, func.count()).group_by(Product.state))
        states = {state.value: count for state, count in counts}
    if states != {ProductState.DONE.value: _PRODUCTS}:
        outcome.violations.append(f"not every one of {_PRODUCTS} products is done: {states}")
    if contradictory := contradictions(target.engine):
        outcome.violations.append(f"published twice with different rows: {', '.join(contradictory[:3])}")
    if calm is not None and calm.rows is not None and outcome.rows is not None and outcome.rows != calm.rows:
        wrong = sum(row != other for row, other in zip_longest(outcome.rows, calm.rows))
        outcome.violations.append(f"{wrong} of {len(calm.rows)} rows are not those of the calm run")
    bound, worst = target.lease + max(_BEYOND_LEASE_SECONDS, 2 * outcome.start_seconds), outcome.standstill
    if worst.standstill > bound:
        outcome.violations.append(
            f"no product was finished for {worst.standstill:.1f} s after {worst.name}; limit: {bound:.1f} s"
        )
    try:
        target.system.supervisor.check()
    except ServiceFailedError as error:
        outcome.violations.append(str(error))
