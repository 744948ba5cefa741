"""A worker process: says what it can make, stays visible as alive, and consumes the queues of its numeric classes.

The process that Celery forks for the work opens its own database connections and its own GL context or network; the parent
only supervises, so that a crash of a driver is a lost child, not a lost worker.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import structlog
from celery import Celery
from celery.signals import worker_process_init, worker_ready

from valerie.broker import EVAL_QUEUE, create_app, route_of
from valerie.db import processes
from valerie.db.engine import open_engine, unforked, writing
from valerie.db.migrate import require_current
from valerie.errors import MissingDependency, TransientError
from valerie.pipeline.base.context import Context, open_context, process_name
from valerie.pipeline.base.requests import BROKER_LOST
from valerie.pipeline.work.child import Child
from valerie.pipeline.work.stages import Maker
from valerie.settings import Settings

log = structlog.get_logger()

_SEEN_EVERY_SECONDS = 3.0
_PROBE_TIMEOUT_SECONDS = 120.0


class Presence:
    """Keeps a worker's row and health file fresh from a thread until `leave`, while Celery may fork at any time."""

    def __init__(self, settings: Settings, stage: str, offers: Sequence[dict[str, Any]]) -> None:
        self._engine = open_engine(settings.database_url)
        self._stop = threading.Event()
        now = time.time()
        self._values: dict[str, Any] = {
            "id": process_name(),
            "stage": stage,
            "host": os.uname().nodename,
            "pid": os.getpid(),
            "offers": list(offers),
            "started_at": now,
            "seen_at": now,
        }
        self._health = settings.data_dir / "health" / f"{stage}-{os.uname().nodename}-{os.getpid()}"
        self._thread = threading.Thread(target=self._run, name="presence", daemon=True)

    def join(self) -> None:
        """Become visible.

        Raises:
            Conflict: the database is older or newer than this version.
            TransientError: the database does not answer.
        """
        require_current(self._engine)
        self._health.parent.mkdir(parents=True, exist_ok=True)
        with unforked(), writing(self._engine) as connection:
            processes.register_worker(connection, self._values)
        self._health.touch()
        self._thread.start()

    def leave(self) -> None:
        """Say goodbye; what fails here is forgotten by time."""
        self._stop.set()
        self._thread.join(timeout=2 * _SEEN_EVERY_SECONDS)
        self._health.unlink(missing_ok=True)
        try:
            with unforked(), writing(self._engine) as connection:
                processes.remove_worker(connection, self._values["id"])
        except TransientError as error:
            log.warning("worker.goodbye", reason=str(error))

    def _run(self) -> None:
        while not self._stop.wait(_SEEN_EVERY_SECONDS):
            try:
                now = time.time()
                with unforked(), writing(self._engine) as connection:
                    if not processes.worker_seen(connection, self._values["id"], now):
                        processes.register_worker(connection, {**self._values, "seen_at": now})
                self._health.touch()
            except (TransientError, OSError) as error:
                log.warning("worker.presence", reason=str(error))


def render_offers(engines: Sequence[str]) -> list[dict[str, Any]]:
    """What this machine renders with; each engine is probed in a process of its own, since a driver may crash.

    Raises:
        MissingDependency: none of ``engines`` works here; says why.
    """
    offers: list[dict[str, Any]] = []
    complaints: list[str] = []
    for engine in engines:
        found, complaint = _probe("render", [engine])
        offers += found
        if complaint:
            complaints.append(f"{engine}: {complaint}")
            log.warning("worker.engine_unavailable", engine=engine, reason=complaint)
    if not offers:
        raise MissingDependency("no render engine works on this machine: " + "; ".join(complaints))
    unique = {(offer["name"], offer["numeric_class"]): offer for offer in offers}
    return [
        {"stage": "render", "route": route_of("render", offer["name"], offer["numeric_class"]), **offer}
        for offer in unique.values()
    ]


def infer_offers(functions: Sequence[str], engines: Sequence[str]) -> list[dict[str, Any]]:
    """What this machine infers with, in the numeric classes that its inference engines really have.

    Args:
        functions: names of installed functions.
        engines: for registered functions, as `valerie.pipeline.functions.probe.inference_names` calls them.

    Raises:
        MissingDependency: none of ``functions`` works here; says why.
    """
    # One process for both: importing an inference library costs more than trying it.
    offers, complaint = _probe("infer", [*functions, *engines])
    if not any("card" in offer for offer in offers):
        offers, complaint = _probe("infer", functions)
    if not offers:
        raise MissingDependency(f"no function under test works on this machine: {complaint}")
    return [{"stage": "infer", "route": f"infer.{offer['numeric_class']}", **offer} for offer in offers]


def _probe(stage: str, names: Sequence[str]) -> tuple[list[dict[str, Any]], str]:
    """(offers, complaint) of `valerie.pipeline.functions.probe`."""
    command = [sys.executable, "-m", "valerie.pipeline.functions.probe", stage, *names]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PROBE_TIMEOUT_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return [], f"it did not answer within {_PROBE_TIMEOUT_SECONDS:g} s"
    complaints = done.stderr.strip().splitlines()
    try:
        offers = json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        offers = []
    if not offers:
        return [], complaints[-1] if complaints else f"its process ended with {done.returncode}"
    return offers, ""


def serve(
    settings: Settings,
    stage: str,
    *,
    offers: Sequence[dict[str, Any]],
    register: Callable[[Celery], Child],
    open_maker: Callable[[Context], Maker],
) -> None:
    """Be a worker of one stage until told to stop.

    Args:
        settings: of this deployment.
        stage: ``render``, ``infer`` or ``eval``.
        offers: what this machine can make; its routes are the queues that are consumed.
        register: declares the stage's tasks on the Celery app.
        open_maker: called in the forked child, before its first task.

    Raises:
        Conflict: the database is older or newer than this version.
        TransientError: the database does not answer.
    """
    app = create_app(settings)
    child = register(app)

    def open_child(**_: object) -> None:
        context = open_context(settings)
        child.open(context, open_maker(context))

    worker_process_init.connect(open_child, weak=False)
    ready = threading.Event()

    def note_ready(**_: object) -> None:
        ready.set()

    worker_ready.connect(note_ready, weak=False)
    presence = Presence(settings, stage, offers)
    presence.join()
    try:
        app.worker_main(
            [
                "--quiet",
                "worker",
                "--pool=prefork",
                "--concurrency=1",
                f"--queues={','.join(sorted({str(offer['route']) for offer in offers}) or [EVAL_QUEUE])}",
                f"--hostname={stage}-{os.getpid()}@%h",
                "--without-gossip",
                "--without-mingle",
                "--without-heartbeat",
                "--loglevel=WARNING",
            ]
        )
    except SystemExit as end:
        if end.code != BROKER_LOST or not ready.is_set():
            raise
    else:
        return
    finally:
        presence.leave()
    log.warning("worker.broker_lost", action="starting anew")
    time.sleep(1.0)
    os.execv(sys.executable, sys.orig_argv)  # noqa: S606  this very program
