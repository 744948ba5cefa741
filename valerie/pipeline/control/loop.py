"""The control loop: feeds runs into the queues within a bounded window, counts progress, and recovers from dead processes.

One process holds the role by a database lease. It may be killed at any time: all its state is in the database, and each step
is one transaction. Another process, or the same one restarted, continues where it stopped.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from typing import Final

import structlog

from valerie.db import processes, products, runs, sweeping, totals
from valerie.db.engine import database_moment, database_time, reading, writing
from valerie.db.runs import RunRow
from valerie.errors import (
    Conflict,
    NotFound,
    QuotaExceeded,
    StorageFull,
    StorageUnavailable,
    TransientError,
    ValerieError,
)
from valerie.parameters.space import ParameterSpace
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.deadlines import with_deadlines
from valerie.pipeline.base.pausing import QUOTA_REASON, STORAGE_REASON, pause_for_storage
from valerie.pipeline.base.pinning import PinChoice, pins_for
from valerie.pipeline.base.resolved_runs import resolve_stored
from valerie.pipeline.base.sending import send_ready
from valerie.pipeline.control import feeding, webhooks
from valerie.pipeline.control.lifecycle import resume
from valerie.pipeline.control.overdue import fail_overdue
from valerie.pipeline.control.progress_counting import ProgressBook
from valerie.pipeline.control.quotas import exhausted, limits_costs, spent_by
from valerie.pipeline.control.sharing import parts_of, weights_of
from valerie.pipeline.control.studies.advancing import StudyKeeper
from valerie.pipeline.functions import registry
from valerie.runs.products.pins import Offer
from valerie.runs.products.states import RunState

log = structlog.get_logger()

ROLE: Final = "control"
#: Seconds between two checks of quotas, and of the store while runs are paused for lack of space.
_PROBE_SECONDS: Final = 5.0


class ControlLoop:
    """The control loop. `run` is the body of a thread; `tick` is one round of it.

    Args:
        context: of this process.
        proposer: advances studies (default: a thread).
    """

    def __init__(self, context: Context, *, proposer: Executor | None = None) -> None:
        self._context = context
        self._settings = context.settings
        self._wake = threading.Event()
        self._book = ProgressBook(context.engine)
        self._feeders: dict[str, feeding.Feeder] = {}
        self._studies = StudyKeeper(context)
        # A strategy may compute for seconds, and a receiver may hang; the lease must be renewed meanwhile.
        proposer = proposer or ThreadPoolExecutor(1, thread_name_prefix="studies")
        self._advancing = _Aside(proposer, self._advance_studies)
        courier = ThreadPoolExecutor(1, thread_name_prefix="webhooks")
        self._delivering = _Aside(courier, lambda: webhooks.deliver(context))
        # Adding up what a large run took may last longer than a lease.
        self._keeping = _Aside(ThreadPoolExecutor(1, thread_name_prefix="quotas"), self._keep_quotas)
        self._finish_sent: dict[str, float] = {}
        #: Runs whose products were left in the queues; None: unknown.
        self._queued: frozenset[str] | None = None
        self._next_sweep = self._next_probe = self._next_count = self._next_quota = -math.inf

    def wake(self) -> None:
        """Begin the next round at once, because something was submitted."""
        self._wake.set()

    def run(self, stop: threading.Event) -> None:
        """Work until ``stop`` is set; faults of the database or the broker are logged, and the round is repeated."""
        pause = 0.5
        while not stop.is_set():
            busy = False
            try:
                busy = self.tick()
                pause = 0.5
            except TransientError as error:
                pause = min(pause * 2, 10.0)
                log.warning("control.waits", reason=str(error), seconds=pause)
            except Exception:
                # A defect in one round must not end feeding for good; the next round tries again.
                pause = min(pause * 2, 10.0)
                log.exception("control.failed", seconds=pause)
            if not busy:
                self._wake.wait(timeout=pause)
                self._wake.clear()
        self._advancing.end()
        self._delivering.end()
        self._keeping.end()
        try:
            with writing(self._context.engine) as connection:
                processes.release_lease(connection, ROLE, owner=self._context.owner)
        except TransientError:
            pass  # the lease expires

    def tick(self, *, everything: bool = False) -> bool:
        """Do one round; return True if there is more to feed at once.

        With ``everything``, also count, sweep and check a full store regardless of their intervals.
        """
        elapsed = self._context.elapsed()
        if everything:
            self._next_count = self._next_sweep = self._next_probe = self._next_quota = elapsed
        with writing(self._context.engine) as connection:
            now = database_time(connection)
            held = processes.hold_lease(
                connection, ROLE, owner=self._context.owner, now=now, seconds=self._settings.lease_seconds
            )
        if not held:
            self._book.forget()
            self._feeders.clear()
            self._queued = None
            self._studies = StudyKeeper(self._context)
            return False
        self._pin_submitted(now)
        with reading(self._context.engine) as connection:
            active = runs.in_states(connection, (RunState.RUNNING, RunState.PAUSED, RunState.FINISHING))
        running = [run for run in active if run.state is RunState.RUNNING]
        paused = [run for run in active if run.state is RunState.PAUSED]
        more = self._feed(running, now)
        if elapsed >= self._next_count:
            started = time.thread_time()
            for run in running:
                self._count(run.id)
            self._advancing.begin(wait=everything)
            # Counting may take at most a tenth of this thread's time.
            self._next_count = self._context.elapsed() + max(0.5, 10 * (time.thread_time() - started))
        self._finish([run.id for run in active if run.state is RunState.FINISHING], elapsed)
        if elapsed >= self._next_sweep:
            self._sweep(now)
            self._park(frozenset(run.id for run in running))
            fail_overdue(self._context, running, now)
            self._next_sweep = elapsed + self._settings.sweep_seconds
            self._guard_space()
            if self._settings.webhook_urls:
                self._delivering.begin(wait=everything)
        if elapsed >= self._next_quota and any(self._is_limited(run) for run in running + paused):
            self._keeping.begin(wait=everything)
        if paused and elapsed >= self._next_probe:
            self._resume_when_possible(paused)
            self._next_probe = elapsed + _PROBE_SECONDS
        self._feeders = {run.id: self._feeders[run.id] for run in running if run.id in self._feeders}
        return more

    # -- feeding ---------------------------------------------------------------------------------------------------------

    def _pin_submitted(self, now: float) -> None:
        """Start the runs whose engine and functions living workers offer, and pin the offers."""
        with reading(self._context.engine) as connection:
            waiting = runs.in_states(connection, (RunState.SUBMITTED,))
            offers = processes.offers_by_worker(connection, now=now) if waiting else []
        for run in waiting:
            pins, reason = self._pins(run, offers) if run.pins is None else PinChoice(run.pins, None)
            with writing(self._context.engine) as connection:
                if pins is None:
                    if reason != run.reason:
                        runs.set_values(connection, run.id, reason=reason)
                else:
                    runs.change_state(
                        connection,
                        run.id,
                        expected=(RunState.SUBMITTED,),
                        state=RunState.RUNNING,
                        pins=with_deadlines(pins, self._settings, now),
                        started_at=run.started_at or database_moment(connection),
                    )

    def _pins(self, run: RunRow, offers: Sequence[Sequence[Offer]]) -> PinChoice:
        """Choose pins; a run whose function was removed before the start fails, since it would wait for ever."""
        names = run.spec.functions
        try:
            with reading(self._context.engine) as connection:
                registry.require_known(connection, names)
                registered = registry.known(connection, names)

                def space() -> ParameterSpace:
                    return resolve_stored(run, self._settings).resolved.space

                return pins_for(connection, run.spec, offers, registered, space)
        except TransientError:
            raise
        except ValerieError as error:
            self._fail(run.id, str(error), expected=RunState.SUBMITTED)
            return PinChoice(None, str(error))

    def _feed(self, running: Sequence[RunRow], now: float) -> bool:
        """Write the next block of each run with variants left and room in the window; return True if there may be more.

        Runs with variants left share the window as they share the workers, so a small run does not wait for a large one. A
        single run has the whole window, and may write its first block even if other runs fill it.
        """
        hungry = [run for run in running if run.next_index < run.variant_count]
        if not hungry:
            return False
        with reading(self._context.engine) as connection:
            room = self._settings.feed_window - totals.unfinished_count(connection)
        weights = weights_of(running, now)
        parts = parts_of(hungry, weights)
        more = False
        for run in sorted(hungry, key=lambda run: self._book.unfinished(run.id)):
            own, part = self._book.unfinished(run.id), parts[run.id]
            if own >= part * self._settings.feed_window if len(hungry) > 1 else room <= 0 < own:
                continue
            feeder = self._feeders.get(run.id)
            if feeder is None:
                try:
                    feeder = self._feeders[run.id] = feeding.Feeder(run, self._settings)
                except TransientError:
                    raise
                except ValerieError as error:
                    self._fail(run.id, str(error))
                    continue
            fed = feeder.feed(self._context.engine, run.next_index, now, part=part, weight=weights[run.id])
            self._book.note_fed(run.id, fed.products)
            self._context.traces.frames(fed.frames)
            more = more or fed.products > 0
            send_ready(self._context, fed.ready)
        return more

    def _fail(self, run_id: str, reason: str, *, expected: RunState = RunState.RUNNING) -> None:
        with writing(self._context.engine) as connection:
            runs.change_state(
                connection,
                run_id,
                expected=(expected,),
                state=RunState.FAILED,
                reason=reason,
                finished_at=database_moment(connection),
            )
        log.error("control.run_failed", run=run_id, reason=reason)

    # -- counting --------------------------------------------------------------------------------------------------------

    def _count(self, run_id: str) -> None:
        if self._book.update(run_id):
            with writing(self._context.engine) as connection:
                runs.change_state(connection, run_id, expected=(RunState.RUNNING,), state=RunState.FINISHING)

    def _finish(self, finishing: Collection[str], elapsed: float) -> None:
        for run_id in finishing:
            if elapsed - self._finish_sent.get(run_id, -math.inf) > self._settings.resend_seconds:
                self._finish_sent[run_id] = elapsed
                try:
                    self._context.broker.send_finish(run_id)
                except TransientError as error:
                    log.warning("control.broker", reason=str(error))
        self._finish_sent = {run_id: sent for run_id, sent in self._finish_sent.items() if run_id in finishing}

    def _advance_studies(self) -> None:
        self._studies.advance()

    # -- sweeping --------------------------------------------------------------------------------------------------------

    def _sweep(self, now: float) -> None:
        """Take back the leases of dead workers, resend lost messages, propagate failures."""
        # One transaction each, since each locks products in the order of their digests.
        with writing(self._context.engine) as connection:
            sweeping.bound_times(connection, now=now, lease_seconds=self._settings.lease_seconds)
        with writing(self._context.engine) as connection:
            expired = sweeping.take_back_expired(connection, now=now, max_attempts=self._settings.max_attempts)
        with writing(self._context.engine) as connection:
            sweeping.fail_orphaned_dependents(connection, now)
        with writing(self._context.engine) as connection:
            late = products.promote_all(connection, now)
        with reading(self._context.engine) as connection:
            stale = sweeping.stale_ready(connection, now=now, resend_seconds=self._settings.resend_seconds, limit=5_000)
        # A message that waits in its queue must not be duplicated: it is lost only if the queue is empty.
        waiting = self._waiting({ready.route for ready in stale}) if stale else {}
        lost = [ready for ready in stale if waiting.get(ready.route) == 0]
        if lost:
            with writing(self._context.engine) as connection:
                sweeping.mark_sent(connection, [ready.digest for ready in lost], now)
        if expired or late or lost:
            log.info("control.swept", expired=len(expired), late=len(late), lost=len(lost))
        send_ready(self._context, [*expired, *late, *lost])

    def _park(self, running: frozenset[str]) -> None:
        """Park what nobody needs any more, if a run has stopped since the last time."""
        if self._queued is None or not self._queued <= running:
            with writing(self._context.engine) as connection:
                sweeping.park_unneeded(connection)
        self._queued = running

    def _waiting(self, routes: Collection[str]) -> dict[str, int]:
        """Return the number of messages in each queue; empty while the broker does not answer."""
        try:
            return self._context.broker.queue_lengths(routes)
        except TransientError as error:
            log.warning("control.broker", reason=str(error))
            return {}

    def _guard_space(self) -> None:
        """Pause the runs before the disk is full, since the database and the logs need space too."""
        try:
            _require_space(self._context)
        except StorageFull as error:
            pause_for_storage(self._context, error)

    def _resume_when_possible(self, paused: Sequence[RunRow]) -> None:
        """Resume the runs that were paused for lack of space once the store can be written again."""
        waiting = [run for run in paused if (run.reason or "").startswith(STORAGE_REASON)]
        if not waiting:
            return
        try:
            _require_space(self._context)
            self._context.store.check()
        except (StorageFull, StorageUnavailable):
            return
        for run in waiting:
            try:
                resume(self._context, run.id)
            except QuotaExceeded as error:  # from now on, it waits for that
                self._pause(run.id, str(error), expected=RunState.PAUSED)
            except (Conflict, NotFound):  # a user was faster
                pass

    # -- quotas ----------------------------------------------------------------------------------------------------------

    def _is_limited(self, run: RunRow) -> bool:
        # A quota that paused a run may have been lifted since.
        return limits_costs(self._settings, run.owner, run.project) or _waits_for_quota(run)

    def _keep_quotas(self) -> None:
        """Pause the runs of owners and projects that have used up CPU hours or bytes, and resume those that have room again.

        That takes at most a tenth of the time.
        """
        started = self._context.elapsed()
        try:
            with reading(self._context.engine) as connection:
                active = runs.in_states(connection, (RunState.RUNNING, RunState.PAUSED))
                spent = spent_by(connection, self._settings, [(run.owner, run.project) for run in active])
                reasons = exhausted(connection, self._settings, active, spent)
            for run in active:
                if run.state is RunState.RUNNING and run.id in reasons:
                    self._pause(run.id, reasons[run.id], expected=RunState.RUNNING)
                elif run.id not in reasons and _waits_for_quota(run):
                    with suppress(Conflict, NotFound):  # a user was faster
                        resume(self._context, run.id)
        finally:
            elapsed = self._context.elapsed()
            self._next_quota = elapsed + max(_PROBE_SECONDS, 10 * (elapsed - started))

    def _pause(self, run_id: str, reason: str, *, expected: RunState) -> None:
        with writing(self._context.engine) as connection:
            runs.change_state(
                connection, run_id, expected=(expected,), state=RunState.PAUSED, reason=QUOTA_REASON + reason
            )


class _Aside:
    """Work that a round begins beside itself, unless it is still at work."""

    def __init__(self, executor: Executor, work: Callable[[], None]) -> None:
        self._executor, self._work = executor, work
        self._running: Future[None] | None = None

    def begin(self, *, wait: bool) -> None:
        """Begin the work; with ``wait``, wait for its end. An error of the last time is raised here."""
        if self._running is None or self._running.done():
            last, self._running = self._running, self._executor.submit(self._work)
            if last is not None:
                last.result()
        if wait:
            self._running.result()

    def end(self) -> None:
        """Wait for the work's end; it does not begin again."""
        self._executor.shutdown()


def _waits_for_quota(run: RunRow) -> bool:
    return run.state is RunState.PAUSED and (run.reason or "").startswith(QUOTA_REASON)


def _require_space(context: Context) -> None:
    free, needed = context.store.free_bytes(), context.settings.min_free_mb * 2**20
    if free is not None and free < needed:
        raise StorageFull(
            f"{free // 2**20} MiB are left in {context.store.url}; runs continue above {needed // 2**20} MiB "
            "(VALERIE_MIN_FREE_MB; free space with `valerie gc`)"
        )
