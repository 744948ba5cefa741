"""The life of a product in a worker: claim → compute → store → publish → notify waiting products.

No transaction is open while computing; a heartbeat thread renews the leases. A worker may be killed at any moment: an object
that was stored but not published is stored again with equal bytes, and a claimed product is released when its lease expires.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from typing import Final, Protocol, runtime_checkable

import structlog

from valerie.db import claiming, products, publishing
from valerie.db.claiming import Job
from valerie.db.engine import database_time, writing
from valerie.db.publishing import Finished
from valerie.db.statements import lock
from valerie.errors import (
    MissingInput,
    StorageFull,
    StorageUnavailable,
    TransientError,
    ValerieError,
)
from valerie.pipeline.base.context import Context
from valerie.pipeline.base.pausing import pause_for_storage
from valerie.pipeline.base.sending import send_ready
from valerie.runs.products.ready import Fault
from valerie.storage.keys import product_key

log = structlog.get_logger()

#: Finished products are published together after at most this time, which bounds the work that a killed worker loses.
_PUBLISH_SECONDS: Final = 1.0
#: Pauses before the second, third … attempt after a transient fault.
_BACKOFF_SECONDS: Final = (1.0, 5.0, 30.0)


class Maker(Protocol):
    """Computes products of one stage and stores their objects."""

    def make(self, job: Job) -> Finished:
        """Compute and store one product.

        Raises:
            MissingInput: an input's object is gone.
            TransientError: another attempt may succeed.
            ValerieError: no attempt can succeed.
        """
        ...


@runtime_checkable
class LooksAhead(Protocol):
    """A maker that can make some products together at a lower cost."""

    def expect(self, jobs: Sequence[Job]) -> None:
        """Announce the next jobs, in order; they hold until the process ends or until the next announcement."""
        ...


@runtime_checkable
class MayEnd(Protocol):
    """A maker that ends this process if a product takes too long, since nothing else stops compiled code."""

    def before_end(self, tell: Callable[[str], None]) -> None:
        """Set the function that is called with the reason before that, from any thread, during the product's computation."""
        ...


def serve_queue(context: Context, maker: Maker, route: str) -> bool:
    """Make the packet of a queue whose turn it is, and before it the products with earlier turns that were tried before.

    Returns:
        False if nothing was ready, or this worker is unfit.
    """
    again, worked = True, False
    while again and context.fitness.fit():
        with writing(context.engine) as connection:
            now, lease = database_time(connection), context.settings.lease_seconds
            jobs = claiming.claim_next(connection, route, owner=context.owner, now=now, lease_seconds=lease)
        # Messages are counted for the packets of products that were never tried.
        again = any(job.attempts > 1 for job in jobs)
        worked = worked or bool(jobs)
        _make(context, maker, jobs)
    return worked


def make_products(context: Context, maker: Maker, digests: Sequence[str]) -> None:
    """Make those of ``digests`` that are ready and still wanted; record what became of each."""
    with writing(context.engine) as connection:
        now, lease = database_time(connection), context.settings.lease_seconds
        jobs = claiming.claim(connection, digests, owner=context.owner, now=now, lease_seconds=lease)
    _make(context, maker, jobs)


def _make(context: Context, maker: Maker, jobs: Sequence[Job]) -> None:
    if not jobs:
        return
    batch = _Batch(context, jobs)
    if isinstance(maker, LooksAhead):
        maker.expect(jobs)
    if isinstance(maker, MayEnd):
        maker.before_end(batch.end)
    with _renewing(context, batch):
        for number, job in enumerate(jobs):
            if not context.fitness.fit():
                batch.leave(jobs[number:])
                break
            batch.begin(job)
            context.fitness.begin()
            began = time.time_ns()
            product = _attempt(context, maker, job)
            context.traces.product(job, began, product)
            if product is not None:
                context.fitness.succeed()
            batch.settle(job, product)
        batch.publish()


class _Batch:
    """The claimed products of one message.

    Three threads share it: the one that computes, the heartbeat that renews the leases, and a guard that may end the process.
    """

    def __init__(self, context: Context, jobs: Sequence[Job]) -> None:
        self._context = context
        self._lock = threading.RLock()
        self._current = jobs[0]
        self._held = {job.digest for job in jobs}
        self._finished: list[Finished] = []
        self._published_at = context.elapsed()

    @property
    def held(self) -> list[str]:
        """The products that this process still holds."""
        with self._lock:
            return list(self._held)

    def begin(self, job: Job) -> None:
        """Record the current product."""
        with self._lock:
            self._current = job

    def settle(self, job: Job, product: Finished | None) -> None:
        """Record a finished product (None: given back or failed); publish if the last publication is some time ago."""
        with self._lock:
            if product is None:
                self._held.discard(job.digest)
            else:
                self._finished.append(product)
            if self._context.elapsed() - self._published_at > _PUBLISH_SECONDS:
                self.publish()

    def leave(self, jobs: Sequence[Job]) -> None:
        """Give products back that this worker did not try."""
        digests = {job.digest for job in jobs}
        with self._lock:
            self._held -= digests
        _give_back(self._context, digests, seconds=0.0, count_attempt=False)

    def publish(self) -> None:
        """Publish the finished products."""
        with self._lock:
            if self._finished:
                _publish(self._context, self._finished)
                self._held.difference_update(product.digest for product in self._finished)
                self._finished = []
            self._published_at = self._context.elapsed()

    def end(self, reason: str) -> None:
        """Publish the finished products and give back the others, because this process ends with the current one unfinished."""
        with self._lock:
            try:
                self.publish()
                rest = self._held - {self._current.digest}
                _give_back(self._context, rest, seconds=0.0, count_attempt=False)
            finally:
                _again_or_never(self._context, self._current, TransientError(reason))


def _attempt(context: Context, maker: Maker, job: Job) -> Finished | None:
    """Make one product; errors are recorded, never raised, so that the rest of the message is processed."""
    try:
        return maker.make(job)
    except MissingInput as error:
        _ask_again(context, job, error)
    except (StorageFull, StorageUnavailable) as error:
        log.warning("stage.storage", digest=job.digest, error=str(error))
        _give_back(context, [job.digest], seconds=0.0, count_attempt=False)
        pause_for_storage(context, error)
    except TransientError as error:
        _again_or_never(context, job, error)
    except MemoryError as error:
        if job.attempts >= context.settings.max_attempts:
            _fail(context, job, error)
        else:
            _give_back(context, [job.digest], seconds=_BACKOFF_SECONDS[0])
    except Exception as error:
        # A defect of ours or of an engine must also become a recorded failure of this product, not a stuck run.
        if not isinstance(error, ValerieError):
            log.exception("stage.defect", digest=job.digest, kind=job.kind)
        _fail(context, job, error)
    return None


def _publish(context: Context, finished: Sequence[Finished]) -> None:
    with writing(context.engine) as connection:
        now = database_time(connection)
        published = publishing.publish(connection, finished, owner=context.owner, now=now)
    lost = {product.digest for product in finished} - set(published)
    if lost:
        log.warning("stage.lease_lost", digests=sorted(lost))
    # A separate transaction: see promote_dependents.
    with writing(context.engine) as connection:
        ready = products.promote_dependents(connection, published, now)
    send_ready(context, ready)


def _fail(context: Context, job: Job, error: BaseException) -> None:
    fault = Fault(
        stage=job.kind,
        type=type(error).__name__,
        message=str(error)[:2000] or type(error).__name__,
        attempts=job.attempts,
    )
    log.error("stage.failed", digest=job.digest, **dict(fault))
    with writing(context.engine) as connection:
        now = database_time(connection)
        products.fail(connection, job.digest, owner=context.owner, error=fault, now=now)


def _again_or_never(context: Context, job: Job, error: TransientError) -> None:
    """Give a product back for another attempt after a pause; after the last attempt, fail it."""
    if job.attempts >= context.settings.max_attempts:
        _fail(context, job, error)
        return
    log.warning("stage.retry", digest=job.digest, kind=job.kind, attempts=job.attempts, error=str(error))
    _give_back(context, [job.digest], seconds=_BACKOFF_SECONDS[min(job.attempts, len(_BACKOFF_SECONDS)) - 1])


def _give_back(context: Context, digests: Collection[str], *, seconds: float, count_attempt: bool = True) -> None:
    with writing(context.engine) as connection:
        claiming.hand_back(
            connection,
            digests,
            owner=context.owner,
            not_before=database_time(connection) + seconds,
            count_attempt=count_attempt,
        )


def _ask_again(context: Context, job: Job, error: MissingInput) -> None:
    """Request a lost input again, and let the product wait for it."""
    if job.attempts >= context.settings.max_attempts:
        _fail(context, job, error)
        return
    log.warning("stage.input_lost", digest=job.digest, input=error.digest)
    context.store.delete(product_key(error.kind, error.digest))  # a damaged object must not be mistaken for the new one
    with writing(context.engine) as connection:
        lock(connection, [job.digest, error.digest])
        claiming.await_inputs(connection, [job.digest], owner=context.owner)
        products.forget(connection, [error.digest])
        ready = products.promote(connection, [error.digest], database_time(connection))
    send_ready(context, ready)


def _renewing(context: Context, batch: _Batch) -> AbstractContextManager[None]:
    """Renew the leases of a batch while the body computes."""

    def beat() -> None:
        # Read before the transaction, since the holder of the batch's lock may be waiting for the database.
        digests = batch.held
        try:
            with writing(context.engine) as connection:
                until = database_time(connection) + context.settings.lease_seconds
                claiming.renew(connection, digests, owner=context.owner, until=until)
        except TransientError as error:
            log.warning("stage.heartbeat", reason=str(error))

    return context.beating(context.settings.heartbeat_seconds, beat)
