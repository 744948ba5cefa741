"""A worker process: it publishes its offers, signals that it is alive, and consumes the queues of its numeric classes.

The process that Celery forks for the work opens its own database connections and its own GL context or network. The parent
only supervises, so that a crash of a driver ends a child, not the worker.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from multiprocessing.sharedctypes import RawArray
from typing import Final, NamedTuple

import structlog
from celery import Celery
from celery.signals import worker_process_init, worker_ready

from valerie.broker import create_celery
from valerie.db import processes
from valerie.db.engine import compared_clocks, open_database, reading, unforked, writing
from valerie.db.migrate import require_current
from valerie.db.processes import WorkerRow
from valerie.errors import InvalidInput, MissingDependency, TransientError
from valerie.parent import end_with_parent
from valerie.pipeline.base.context import Context, open_context, process_name
from valerie.pipeline.base.fitness import Counts, Fitness
from valerie.pipeline.base.requests import BROKER_LOST
from valerie.pipeline.work.asking import ask_for_work
from valerie.pipeline.work.child import Child
from valerie.pipeline.work.stages import Maker
from valerie.runs.products.pins import TRUTH, AnyOffer, FunctionOffer, Probed
from valerie.runs.products.states import EVAL_QUEUE, Stage
from valerie.settings import NO_BROKER, Settings

log = structlog.get_logger()

_SEEN_EVERY_SECONDS: Final = 3.0
_PROBE_TIMEOUT_SECONDS: Final = 300.0  # a machine that is busy may take minutes for what takes seconds


class Presence:
    """Thread that refreshes a worker's row and health file from `join` until `leave`, while Celery may fork at any time."""

    def __init__(self, settings: Settings, stage: Stage) -> None:
        self._engine = open_database(settings.database_url, seconds=settings.database_seconds)
        self._stop = threading.Event()
        self._worker = WorkerRow(
            id=process_name(),
            stage=stage,
            host=os.uname().nodename,
            pid=os.getpid(),
            offers=(),
            started_at=0.0,
            seen_at=0.0,
        )
        self._health = settings.data_dir / "health" / f"{stage}-{os.uname().nodename}-{os.getpid()}"
        self._thread = threading.Thread(target=self._run, name="presence", daemon=True)

    def open_context(self, settings: Settings, failures: Counts) -> Context:
        """Open the context of a process that works for this worker.

        Leases name the worker, so that people see who makes what; each child of a worker has a name of its own. After failures
        in a row, it tests the machine and writes the result into the worker's row.
        """
        worker, context = self._worker, open_context(settings)

        def test() -> bool:
            reason = ailment(worker.stage, worker.offers)
            if reason:
                log.error("worker.unfit", reason=reason)
            try:
                with writing(context.engine) as connection:
                    processes.rest(connection, worker.id, reason)
            except TransientError as error:
                log.warning("worker.presence", reason=str(error))
            return reason is None

        return replace(context, owner=processes.owner_of(worker.id), fitness=Fitness(test, failures))

    def specimen_keys(self) -> frozenset[str]:
        """Return the keys of the specimens in the database, which this worker need not make.

        Raises:
            Conflict: the database is older or newer than this version.
            TransientError: the database does not answer.
        """
        require_current(self._engine)
        with reading(self._engine) as connection:
            return processes.specimen_keys(connection)

    def join(self, machine: Probed) -> None:
        """Become visible with what this machine offers.

        Raises:
            TransientError: the database does not answer.
        """
        self._health.parent.mkdir(parents=True, exist_ok=True)
        with unforked(), writing(self._engine) as connection:
            now, ahead = compared_clocks(connection)
            self._worker = replace(self._worker, offers=machine.offers, started_at=now, seen_at=now, clock_ahead=ahead)
            processes.register_worker(connection, self._worker)
            processes.keep_specimens(connection, machine.specimens)
        self._health.touch()
        self._thread.start()

    def leave(self) -> None:
        """Delete the row; if that fails, the row expires."""
        self._stop.set()
        self._thread.join(timeout=2 * _SEEN_EVERY_SECONDS)
        self._health.unlink(missing_ok=True)
        try:
            with unforked(), writing(self._engine) as connection:
                processes.remove_worker(connection, self._worker.id)
        except TransientError as error:
            log.warning("worker.goodbye", reason=str(error))
        self._engine.dispose()

    def _run(self) -> None:
        while not self._stop.wait(_SEEN_EVERY_SECONDS):
            for sign in (self._health.touch, self._refresh):  # each also where the other fails: a database may be away
                try:
                    sign()
                except (TransientError, OSError) as error:
                    log.warning("worker.presence", reason=str(error))

    def _refresh(self) -> None:
        with unforked(), writing(self._engine) as connection:
            now, ahead = compared_clocks(connection)
            if not processes.worker_seen(connection, self._worker.id, now, ahead):
                processes.register_worker(connection, replace(self._worker, seen_at=now, clock_ahead=ahead))


def render_offers(engines: Sequence[str], stored: Collection[str] = ()) -> Probed:
    """Return the offers of render engines here, with their specimens.

    Each engine is probed in a separate process, since a driver may crash.

    Args:
        engines: names of the engines.
        stored: keys of specimens that are not made again.

    Raises:
        MissingDependency: none of ``engines`` works here; states the reasons.
    """
    offers: list[AnyOffer] = []
    specimens: dict[str, bytes] = {}
    complaints: list[str] = []
    for engine in engines:
        working, complaint = _probe(Stage.RENDER, [engine], stored)
        offers += working.offers
        specimens |= working.specimens
        if complaint:
            complaints.append(f"{engine}: {complaint}")
            log.warning("worker.engine_unavailable", engine=engine, reason=complaint)
    if not offers:
        raise MissingDependency("no render engine works on this machine: " + "; ".join(complaints))
    return Probed(offers=tuple({offer.route: offer for offer in offers}.values()), specimens=specimens)


def infer_offers(functions: Sequence[str], engines: Sequence[str], stored: Collection[str] = ()) -> Probed:
    """Return the offers of functions and inference engines here, with their actual numeric classes and specimens.

    Args:
        functions: names of installed functions.
        engines: inference engines for registered functions, from `valerie.pipeline.functions.probe.inference_names`.
        stored: keys of specimens that are not made again.

    Raises:
        MissingDependency: none of ``functions`` works here; states the reason.
    """
    # One process for both, since importing an inference library takes longer than testing it.
    machine, complaint = _probe(Stage.INFER, [*functions, *engines], stored)
    if not any(isinstance(offer, FunctionOffer) for offer in machine.offers):
        machine, complaint = _probe(Stage.INFER, functions, stored)
    if not machine.offers:
        raise MissingDependency(f"no function under test works on this machine: {complaint}")
    return machine


def ailment(stage: Stage, offers: Sequence[AnyOffer]) -> str | None:
    """Test this machine again, in separate processes; return why it no longer has all of ``offers``, or None if it has."""
    names = list(dict.fromkeys(offer.name for offer in offers if offer.name != TRUTH))
    for together in [names] if stage is Stage.INFER and names else [[name] for name in names]:
        present = _probe(stage, together).machine.offers
        for offer in offers:
            if offer.name not in together or _offers_same(present, offer):
                continue
            alone = _probe(stage, [offer.name])  # the complaint is of this one, and no chance failure
            if not _offers_same(alone.machine.offers, offer):
                return f"{offer.name}: {alone.complaint or f'it is not in the numeric class {offer.numeric_class} any more'}"
    return None


def _offers_same(offers: Sequence[AnyOffer], offer: AnyOffer) -> bool:
    return any((other.route, other.name) == (offer.route, offer.name) for other in offers)


class _Answer(NamedTuple):
    """What works on this machine, or the reason why nothing does."""

    machine: Probed
    complaint: str


def _probe(stage: Stage, names: Sequence[str], stored: Collection[str] = ()) -> _Answer:
    """Run `valerie.pipeline.functions.probe`."""
    command = [sys.executable, "-m", "valerie.pipeline.functions.probe", stage, *names]
    try:
        done = subprocess.run(
            command,
            input="\n".join(sorted(stored)),
            capture_output=True,
            text=True,
            timeout=_PROBE_TIMEOUT_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _Answer(Probed(offers=()), f"it did not answer within {_PROBE_TIMEOUT_SECONDS:g} s")
    complaints = done.stderr.strip().splitlines()
    try:
        machine = Probed.model_validate_json(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        machine = Probed(offers=())
    if not machine.offers:
        return _Answer(machine, complaints[-1] if complaints else f"its process ended with {done.returncode}")
    return _Answer(machine, "")


def serve(
    settings: Settings,
    stage: Stage,
    *,
    probe: Callable[[Collection[str]], Probed],
    register: Callable[[Celery], Child],
    open_maker: Callable[[Context], Maker],
) -> None:
    """Run a worker of one stage until it is stopped, or idle for `Settings.worker_idle_seconds`.

    Args:
        settings: settings of this deployment.
        stage: stage of its products.
        probe: returns what this machine offers, without the specimens of the given keys. The routes of its offers are the
            queues that are consumed.
        register: declares the stage's tasks on the Celery app.
        open_maker: called in the forked child, before its first task.

    Raises:
        Conflict: the database is older or newer than this version.
        InvalidInput: there is no broker, and the worker shall wait for messages.
        MissingDependency: this machine offers nothing.
        TransientError: the database does not answer.
    """
    if settings.broker_url == NO_BROKER and settings.worker_idle_seconds is None:
        raise InvalidInput(
            "without a broker, a worker has to ask the database",
            field="VALERIE_WORKER_IDLE_SECONDS",
            limit="the seconds without work after which the worker ends",
        )
    presence = Presence(settings, stage)
    machine = probe(presence.specimen_keys())
    routes = sorted({offer.route for offer in machine.offers}) or [EVAL_QUEUE]
    if settings.worker_idle_seconds is not None:
        _serve_asking(settings, presence, machine, routes, open_maker)
        return
    app = create_celery(settings)
    child = register(app)
    failures = RawArray(ctypes.c_int, Fitness.counts())  # in memory that all children share

    def open_child(**_: object) -> None:
        end_with_parent(signal.SIGKILL)  # otherwise a child would continue working on a product for nobody
        context = presence.open_context(settings, failures)
        child.open(context, open_maker(context))

    worker_process_init.connect(open_child, weak=False)
    ready = threading.Event()
    worker_ready.connect(lambda **_: ready.set(), weak=False)
    presence.join(machine)
    try:
        app.worker_main(
            [
                "--quiet",
                "worker",
                "--pool=prefork",
                "--concurrency=1",
                f"--queues={','.join(routes)}",
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
    log.warning("worker.broker_lost", action="restarting")
    time.sleep(1.0)
    os.execv(sys.executable, sys.orig_argv)  # noqa: S606  this very program


def _serve_asking(
    settings: Settings,
    presence: Presence,
    machine: Probed,
    routes: Sequence[str],
    open_maker: Callable[[Context], Maker],
) -> None:
    """Run a worker that asks the database for work; a batch system restarts it if a driver ends the process."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())  # ends after the products in work
    presence.join(machine)
    try:
        context = presence.open_context(settings, Fitness.counts())
        ask_for_work(context, open_maker(context), routes, stop)
    finally:
        presence.leave()
